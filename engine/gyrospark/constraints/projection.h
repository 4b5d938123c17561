/* Projection onto the constraints g(q) = 0 and onto the conditions on momenta, G H_p + g_t = 0. */
#ifndef GS_CONSTRAINTS_PROJECTION_H
#define GS_CONSTRAINTS_PROJECTION_H

#include "gyrospark/linear_algebra/norms.h"

#if GS_VELOCITY_CONSTRAINTS
#include "gyrospark/velocity_constraints/conditions.h"
#else
/* The conditions on momenta are the hidden constraints alone. */
enum { HIDDEN = M };
#define momentum_defect(c, q, p, f) hidden_constraint(c, q, p, f)
#define observed_defect(c, q, p, f) hidden_constraint(c, q, p, f)
#define condition_force(c, q, lambda, force) constraint_force(c, q, lambda, force)
#endif

#if GS_CONSTRAINED
#if GS_ELEMENTS
/* Largest accepted step of q that stagnates, in units of epsilon times the state. */
enum { COORDINATE_SLACK = 1024 };

/* f <- W^-1 f with W = G H_pp G^T */
static int solve_momentum(const constants *c, const real q[N], const real p[N], real f[M])
{
    real W[FACTOR];
    schur(c, q, p, W);
    factor(W);
    substitute(W, f);
    return isfinite(norm(M, f)) ? OK : SINGULAR;
}

/* g <- (G G^T)^-1 g */
static int solve_coordinates(const constants *c, const real q[N], real g[M])
{
    real W[FACTOR];
    gram(c, q, W);
    factor(W);
    substitute(W, g);
    return isfinite(norm(M, g)) ? OK : SINGULAR;
}
#else
#include "gyrospark/linear_algebra/dense_lu.h"

/* Largest accepted step of q that stagnates, in units of epsilon times the state. */
enum { COORDINATE_SLACK = 2 };

/* G^T lambda */
static void constraint_force(const constants *c, const real q[N], const real lambda[M],
    real force[N])
{
    real G[M][N];
    constraint_jacobian(c, q, G);
    for (int a = 0; a < N; ++a) {
        force[a] = 0;
        for (int mu = 0; mu < M; ++mu)
            force[a] += G[mu][a]*lambda[mu];
    }
}

#if !(GS_SPLITTING && GS_PROFILE_RUN)
/* reach[mu] = max_a |G[mu][a]|: largest change of g_mu per unit displacement of one coordinate */
static void constraint_reach(const constants *c, const real q[N], real reach[M])
{
    real G[M][N];
    constraint_jacobian(c, q, G);
    for (int mu = 0; mu < M; ++mu)
        reach[mu] = norm(N, G[mu]);
}
#endif

#if !GS_VELOCITY_CONSTRAINTS
/* f <- W^-1 f with W = (df/dp) G^T */
static int solve_momentum(const constants *c, const real q[N], const real p[N], real f[M])
{
    real W[M][M];
    int exponents[M], pivots[M];
    hidden_matrix(c, q, p, W);
    return solve(M, &W[0][0], f, exponents, pivots);
}
#endif

/* g <- (G G^T)^-1 g */
static int solve_coordinates(const constants *c, const real q[N], real g[M])
{
    real G[M][N], W[M][M];
    int exponents[M], pivots[M];
    constraint_jacobian(c, q, G);
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu) {
            W[mu][nu] = 0;
            for (int a = 0; a < MEASURED; ++a)
                W[mu][nu] += G[mu][a]*G[nu][a];
        }
    return solve(M, &W[0][0], g, exponents, pivots);
}
#endif

/*
 * Projects q along G^T onto g(q) = 0 by minimum-norm Newton steps, q <- q - G^T (G G^T)^-1 g, at the
 * same time.
 */
static int project_coordinates(const constants *c, real q[N])
{
    real previous = HUGE_VAL;
    for (int iteration = 0; iteration < 50; ++iteration) {
        real g[M], change[N];
        constraint(c, q, g);
        const int status = solve_coordinates(c, q, g);
        if (status != OK)
            return status;
        constraint_force(c, q, g, change);
        for (int a = 0; a < MEASURED; ++a)
            q[a] -= change[a];
        const real step = norm(MEASURED, change), floor = epsilon*norm(MEASURED, q);
        if (!isfinite(step))
            return NOT_FINITE;
        if (step <= 2*floor || (step <= COORDINATE_SLACK*floor && step >= previous/2))
            return OK;
        previous = step;
    }
    return NOT_CONVERGED;
}
#endif

/*
 * Projects p along G^T, with velocity constraints [G; A]^T, onto f(q, p) = 0 by Newton's method,
 * p <- p - G^T W^-1 f, until the step is at round-off level; impulse is the sum of all W^-1 f. One
 * step is exact if H is quadratic in p, but for round-off. (Hairer-Lubich-Wanner, IV.4 and VII.1)
 */
static int project_momentum(const constants *c, const real q[N], real p[N],
    real impulse[HIDDEN])
{
    enum { SLACK = 1024 }; /* as COORDINATE_SLACK: f has the round-off of differences */
    real previous = HUGE_VAL;
    for (int mu = 0; mu < HIDDEN; ++mu)
        impulse[mu] = 0;
    for (int iteration = 0; iteration < 20; ++iteration) {
        real f[HIDDEN], change[N];
        momentum_defect(c, q, p, f);
        const int status = solve_momentum(c, q, p, f);
        if (status != OK)
            return status;
        condition_force(c, q, f, change);
        for (int a = 0; a < N; ++a)
            p[a] -= change[a];
        for (int mu = 0; mu < HIDDEN; ++mu)
            impulse[mu] += f[mu];
        const real step = norm(MEASURED, change), floor = epsilon*norm(MEASURED, p);
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
    real impulse[HIDDEN];
    int status = OK;
    prepare(parameters, &c);
    const constants *at = AT(&c, start_time(parameters));
    IF_CONSTRAINED(status = project_coordinates(at, q);)
    return status == OK ? project_momentum(at, q, p, impulse) : status;
}

#if !GS_PROFILE_RUN
void NAME(defects)(const parameters_t *parameters, long count, IF_TIME(
    const real *t,) const real *q, const real *p,
    real *g, real *f)
{
    constants c;
    prepare(parameters, &c);
    (void)g; /* without constraints g(q) = 0 */
    for (long i = 0; i < count; ++i) {
        const constants *at = AT(&c, time_of(parameters, t, i));
        IF_CONSTRAINED(constraint(at, q + i*N, g + i*M);)
        observed_defect(at, q + i*N, p + i*N, f + i*HIDDEN);
    }
}
#endif

#endif
