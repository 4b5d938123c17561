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

#if !GS_SPLITTING
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
        if (step <= 2*floor || (step <= (real)COORDINATE_SLACK*floor && step >= previous/2))
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
        if (step <= floor/2 || (step <= (real)SLACK*floor && step >= previous/2))
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

static real euclidean_norm(const real x[N])
{
    real square = 0;
    for (int a = 0; a < N; ++a)
        square += x[a]*x[a];
    return MATH(sqrt)(square);
}

/* A fraction of 1/2 to 1 with pseudo-random sign: none is near 0. */
static real random_fraction(unsigned *seed)
{
    *seed = *seed*1664525u + 1013904223u;
    const real size = (real)0.5 + (real)(*seed >> 8 & 0x7fffffu)/(real)0x1000000;
    return *seed >> 31 ? -size : size;
}

/* d <- [g; f] at (q + sign*move[0], p + sign*move[1]) */
static void moved_defect(const constants *c, const real q[N], const real p[N], int sign,
    real move[2][N], real d[M + HIDDEN])
{
    real moved[2][N];
    for (int a = 0; a < N; ++a) {
        moved[0][a] = q[a] + (real)sign*move[0][a];
        moved[1][a] = p[a] + (real)sign*move[1][a];
    }
    IF_CONSTRAINED(constraint(c, moved[0], d);)
    observed_defect(c, moved[0], moved[1], d + M);
}

/*
 * The bound of g and f is what a move by 64 epsilon of |q| and |p| changes them by. It is measured
 * with larger moves forth and back, whose half difference has no term of second order, and scaled
 * down. All coordinates move at once by random fractions: g and f change by no more than the sum
 * over moves of each coordinate by itself.
 */
int NAME(is_consistent)(const parameters_t *parameters, const real q[N], const real p[N])
{
    enum { MOVES = 2, UNITS = 64 };
    const real size = MATH(sqrt)(MATH(sqrt)(epsilon))/1024, factor = (real)UNITS*epsilon/size/2;
    const real q_size = size*euclidean_norm(q), p_size = size*euclidean_norm(p);
    real move[2][N], d[M + HIDDEN], forth[M + HIDDEN], back[M + HIDDEN];
    real change[2] = { 0, 0 }; /* the largest of g, of f */
    unsigned seed = 1;
    constants c;
    prepare(parameters, &c);
    const constants *at = AT(&c, start_time(parameters));
    for (int a = 0; a < N; ++a)
        move[0][a] = move[1][a] = 0;
    moved_defect(at, q, p, 0, move, d);
    for (int k = 0; k < MOVES; ++k) {
        for (int a = 0; a < N; ++a) {
            move[0][a] = q_size*random_fraction(&seed);
            move[1][a] = p_size*random_fraction(&seed);
        }
        moved_defect(at, q, p, 1, move, forth);
        moved_defect(at, q, p, -1, move, back);
        for (int i = 0; i < M + HIDDEN; ++i)
            change[i >= M] = larger(change[i >= M], MATH(fabs)(forth[i] - back[i]));
    }
    for (int i = 0; i < M + HIDDEN; ++i)
        if (!(MATH(fabs)(d[i]) <= factor*change[i >= M])) /* NaN is not within it */
            return 0;
    return 1;
}
#endif

#endif
