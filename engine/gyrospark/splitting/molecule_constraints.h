/* Constraints of one of many equal molecules: |q|^2 = 1, so that all matrices are numbers. */
#ifndef GS_SPLITTING_MOLECULE_CONSTRAINTS_H
#define GS_SPLITTING_MOLECULE_CONSTRAINTS_H

#include "gyrospark/linear_algebra/norms.h"

/* Each molecule is projected alone: PARTS times, constraints and coordinates of one. */
enum { PARTS = MOLECULES, PART_M = 1, PART_N = COORDINATES };

/* Largest accepted step of a projection that stagnates, in units of epsilon times the state. */
enum { COORDINATE_SLACK = 2, MOMENTUM_SLACK = 4 };

static void constraint(const constants *c, const real q[PART_N], real g[PART_M])
{
    molecule_constraint(c, q, g);
}

static void hidden_constraint(const constants *c, const real q[PART_N], const real p[PART_N],
    real f[PART_M])
{
    molecule_hidden_constraint(c, q, p, f);
}

/* G^T lambda */
static void constraint_force(const constants *c, const real q[PART_N],
    const real lambda[PART_M], real force[PART_N])
{
    real G[1][PART_N];
    molecule_constraint_jacobian(c, q, G);
    for (int a = 0; a < PART_N; ++a)
        force[a] = G[0][a]*lambda[0];
}

/* f <- W^-1 f with W = (df/dp) G^T */
static int solve_momentum(const constants *c, const real q[PART_N], const real p[PART_N],
    real f[PART_M])
{
    real W[1][1];
    molecule_hidden_matrix(c, q, p, W);
    f[0] /= W[0][0];
    return isfinite(f[0]) ? OK : SINGULAR;
}

/* g <- (G G^T)^-1 g */
static int solve_coordinates(const constants *c, const real q[PART_N], real g[PART_M])
{
    real G[1][PART_N], square = 0;
    molecule_constraint_jacobian(c, q, G);
    for (int a = 0; a < PART_N; ++a)
        square += G[0][a]*G[0][a];
    g[0] /= square;
    return isfinite(g[0]) ? OK : SINGULAR;
}

#endif
