/* Constraints of many equal molecules: |q|^2 = 1 of each, so that all matrices are diagonal. */
#ifndef GS_SPLITTING_MOLECULE_CONSTRAINTS_H
#define GS_SPLITTING_MOLECULE_CONSTRAINTS_H

#include "gyrospark/linear_algebra/norms.h"

/* Largest accepted step of a projection that stagnates, in units of epsilon times the state. */
enum { COORDINATE_SLACK = 2, MOMENTUM_SLACK = 4 };

static void constraint(const constants *c, const real q[N], real g[M])
{
    for (int i = 0; i < MOLECULES; ++i)
        molecule_constraint(c, q + COORDINATES*i, g + i);
}

static void hidden_constraint(const constants *c, const real q[N], const real p[N], real f[M])
{
    for (int i = 0; i < MOLECULES; ++i)
        molecule_hidden_constraint(c, q + COORDINATES*i, p + COORDINATES*i, f + i);
}

/* G^T lambda */
static void constraint_force(const constants *c, const real q[N], const real lambda[M],
    real force[N])
{
    for (int i = 0; i < MOLECULES; ++i) {
        real G[1][COORDINATES];
        molecule_constraint_jacobian(c, q + COORDINATES*i, G);
        for (int a = 0; a < COORDINATES; ++a)
            force[COORDINATES*i + a] = G[0][a]*lambda[i];
    }
}

/* reach[mu] = max_a |G[mu][a]|: largest change of g_mu per unit displacement of one coordinate */
static void constraint_reach(const constants *c, const real q[N], real reach[M])
{
    for (int i = 0; i < MOLECULES; ++i) {
        real G[1][COORDINATES];
        molecule_constraint_jacobian(c, q + COORDINATES*i, G);
        reach[i] = norm(COORDINATES, G[0]);
    }
}

/* f <- W^-1 f with W = (df/dp) G^T */
static int solve_momentum(const constants *c, const real q[N], const real p[N], real f[M])
{
    for (int i = 0; i < MOLECULES; ++i) {
        real W[1][1];
        molecule_hidden_matrix(c, q + COORDINATES*i, p + COORDINATES*i, W);
        f[i] /= W[0][0];
    }
    return isfinite(norm(M, f)) ? OK : SINGULAR;
}

/* g <- (G G^T)^-1 g */
static int solve_coordinates(const constants *c, const real q[N], real g[M])
{
    for (int i = 0; i < MOLECULES; ++i) {
        real G[1][COORDINATES], square = 0;
        molecule_constraint_jacobian(c, q + COORDINATES*i, G);
        for (int a = 0; a < COORDINATES; ++a)
            square += G[0][a]*G[0][a];
        g[i] /= square;
    }
    return isfinite(norm(M, g)) ? OK : SINGULAR;
}

#endif
