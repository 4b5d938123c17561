/* Conditions on the momenta with velocity constraints: g_q H_p + g_t = 0 and A(q) H_p + a(q) = 0. */
#ifndef GS_VELOCITY_CONSTRAINTS_CONDITIONS_H
#define GS_VELOCITY_CONSTRAINTS_CONDITIONS_H

#include "gyrospark/linear_algebra/dense_lu.h"
#include "gyrospark/spark/rates_by_state.h"

/* Number of conditions on the momenta: hidden constraints, and velocity constraints. */
enum { HIDDEN = M + ROWS };

/* B <- [g_q; A], the directions of all constraint forces */
static void force_directions(const constants *c, const real q[N], real B[HIDDEN][N])
{
    IF_CONSTRAINED(constraint_jacobian(c, q, B);)
    velocity_rows(c, q, B + M);
}

/* f <- [g_q v + g_t; A v + a] with v = H_p(q, p) */
static void momentum_defect(const constants *c, const real q[N], const real p[N], real f[HIDDEN])
{
    const real t = 0; /* of forces, which do not enter H_p */
    real H_q[N], H_p[N];
    gradient(c, q, p, &t, H_q, H_p);
    velocity_defect(c, q, H_p, f);
}

/* f <- [f(q, p); A H_p + a], with the hidden constraints f in their shortest form */
static void observed_defect(const constants *c, const real q[N], const real p[N], real f[HIDDEN])
{
    momentum_defect(c, q, p, f);
    IF_CONSTRAINED(hidden_constraint(c, q, p, f);)
}

/* f <- W^-1 f with W = B H_pp B^T */
static int solve_momentum(const constants *c, const real q[N], const real p[N], real f[HIDDEN])
{
    const real t = 0;
    real H_qq[N][N], H_qp[N][N], H_pq[N][N], H_pp[N][N], B[HIDDEN][N], W[HIDDEN][HIDDEN];
    int exponents[HIDDEN], pivots[HIDDEN];
    force_directions(c, q, B);
    rates_by_state(c, q, p, &t, H_qq, H_qp, H_pq, H_pp);
    for (int i = 0; i < HIDDEN; ++i)
        for (int j = 0; j < HIDDEN; ++j) {
            W[i][j] = 0;
            for (int a = 0; a < N; ++a)
                for (int b = 0; b < N; ++b)
                    W[i][j] += B[i][a]*H_pp[a][b]*B[j][b];
        }
    return solve(HIDDEN, &W[0][0], f, exponents, pivots);
}

/* force <- B^T mu */
static void condition_force(const constants *c, const real q[N], const real mu[HIDDEN],
    real force[N])
{
    real B[HIDDEN][N];
    force_directions(c, q, B);
    for (int a = 0; a < N; ++a) {
        force[a] = 0;
        for (int i = 0; i < HIDDEN; ++i)
            force[a] += B[i][a]*mu[i];
    }
}

#endif
