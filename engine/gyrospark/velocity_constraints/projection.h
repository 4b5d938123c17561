/* Projection of a state onto g(q) = 0, g_q H_p + g_t = 0 and A(q) H_p + a(q) = 0. */
#ifndef GS_VELOCITY_CONSTRAINTS_PROJECTION_H
#define GS_VELOCITY_CONSTRAINTS_PROJECTION_H

#include "gyrospark/linear_algebra/dense_lu.h"
#include "gyrospark/spark/rates_by_state.h"

#if GS_CONSTRAINED
#include "gyrospark/constraints/projection.h"
#endif

/* Number of conditions on the momenta: hidden constraints, and velocity constraints. */
enum { HIDDEN = M + ROWS };

/* B <- [g_q; A], the directions of all constraint forces */
static void force_directions(const constants *c, const real q[N], real B[HIDDEN][N])
{
#if GS_CONSTRAINED
    constraint_jacobian(c, q, B);
#endif
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
#if GS_CONSTRAINED
    hidden_constraint(c, q, p, f);
#endif
}

/*
 * Projects p along B^T, p <- p - B^T (B H_pp B^T)^-1 f, onto momentum_defect = 0, until the step is
 * at round-off level. One step is exact if H is quadratic in p, but for round-off.
 */
static int project_momentum(const constants *c, const real q[N], real p[N])
{
    enum { SLACK = 1024 }; /* largest accepted step that stagnates, in units of epsilon times |p| */
    real previous = HUGE_VAL;
    for (int iteration = 0; iteration < 20; ++iteration) {
        const real t = 0;
        real H_qq[N][N], H_qp[N][N], H_pq[N][N], H_pp[N][N];
        real B[HIDDEN][N], W[HIDDEN][HIDDEN], f[HIDDEN], change[N];
        int exponents[HIDDEN], pivots[HIDDEN];
        momentum_defect(c, q, p, f);
        force_directions(c, q, B);
        rates_by_state(c, q, p, &t, H_qq, H_qp, H_pq, H_pp);
        for (int i = 0; i < HIDDEN; ++i)
            for (int j = 0; j < HIDDEN; ++j) {
                W[i][j] = 0;
                for (int a = 0; a < N; ++a)
                    for (int b = 0; b < N; ++b)
                        W[i][j] += B[i][a]*H_pp[a][b]*B[j][b];
            }
        const int status = solve(HIDDEN, &W[0][0], f, exponents, pivots);
        if (status != OK)
            return status;
        for (int a = 0; a < N; ++a) {
            change[a] = 0;
            for (int i = 0; i < HIDDEN; ++i)
                change[a] += B[i][a]*f[i];
            p[a] -= change[a];
        }
        const real step = norm(N, change), floor = epsilon*norm(N, p);
        if (!isfinite(step))
            return NOT_FINITE;
        if (step <= floor/2 || (step <= SLACK*floor && step >= previous/2))
            return OK;
        previous = step;
    }
    return NOT_CONVERGED;
}

int NAME(project)(const parameters_t *parameters, real q[N], real p[N])
{
    constants c;
    prepare(parameters, &c);
#if GS_CONSTRAINED
    const int status = project_coordinates(AT(&c, start_time(parameters)), q);
    if (status != OK)
        return status;
#endif
    return project_momentum(AT(&c, start_time(parameters)), q, p);
}

void NAME(defects)(const parameters_t *parameters, long count, IF_TIME(
    const real *t,) const real *q, const real *p,
    real *g, real *f)
{
    constants c;
    prepare(parameters, &c);
    (void)g; /* without constraints g(q) = 0 */
    for (long i = 0; i < count; ++i) {
        IF_TIME(at_time(&c, time_of(parameters, t, i));)
#if GS_CONSTRAINED
        constraint(&c, q + i*N, g + i*M);
#endif
        observed_defect(&c, q + i*N, p + i*N, f + i*HIDDEN);
    }
}

#endif
