/* Newton's method for the nonlinear system of phase T1. */
#ifndef GS_NEWTON_NEWTON_H
#define GS_NEWTON_NEWTON_H

#if GS_ELEMENTS
#include "gyrospark/linear_algebra/band_lu.h"
#else
#include "gyrospark/linear_algebra/dense_lu.h"
#endif

#if GS_SPARK
#if !GS_ELEMENTS
#include "gyrospark/spark/jacobian.h"
#endif

#include "gyrospark/spark/step_end.h"
#else
#if !GS_ELEMENTS
#include "gyrospark/midpoint/jacobian.h"
#endif

#include "gyrospark/midpoint/step_end.h"
#endif

/* Factorises the Jacobian at the last residual: condensed, or all of it if H_pp is singular. */
static int factorise_jacobian(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
#if GS_CONDENSED
    w->is_condensed = 1;
    const int status = condensed_factorise(w, dt, q, x);
    if (status != SINGULAR)
        return status;
    w->is_condensed = 0;
#endif
    jacobian(w, dt, q, p, x, w->J);
#if GS_ELEMENTS
    return band_factorise(U, BAND, w->J, w->pivots, w->forward, w->rows, &w->products);
#else
    return lu_factorise(U, w->J, w->exponents, w->pivots, &w->products);
#endif
}

/* b <- J^-1 b from the factors of J */
static int solve_jacobian(work_t *w, real dt, real b[U])
{
#if GS_CONDENSED
    if (w->is_condensed)
        return condensed_solve(w, dt, b);
#endif
#if GS_ELEMENTS
    (void)dt;
    return band_solve(w->J, w->pivots, b, w->forward);
#else
    (void)dt;
    return lu_substitute(U, w->J, w->exponents, w->pivots, b);
#endif
}

/* Checks g(q1): a small increment relative to large unknowns does not imply a small residual. */
static int satisfies_constraints(work_t *w, real dt, const real q[N], const real x[U])
{
#if GS_CONSTRAINED
    real d[N], q1[N], g[M], dg[M], reach[M];
    displacement(dt, x, d);
    for (int a = 0; a < N; ++a)
        q1[a] = q[a] + d[a];
    constraint(AT(&w->constants, w->t), q, g);
    constraint_increment(BETWEEN(&w->constants, w->t, w->step), q, d, dg);
    constraint_reach(AT(&w->constants, w->t + w->step), q1, reach);
    const real tolerance = norm(MEASURED, d)/1000 + 64*epsilon*norm(MEASURED, q);
    for (int mu = 0; mu < M; ++mu) {
        const real allowed = MATH(fabs)(g[mu]) + reach[mu]*tolerance;
        if (!(MATH(fabs)(g[mu] + dg[mu]) <= allowed))
            return isfinite(allowed) ? DIVERGED : NOT_FINITE;
    }
#else
    (void)w, (void)dt, (void)q, (void)x; /* the convergence test suffices */
#endif
    return OK;
}

/*
 * Returns 1 if the increment in w->r is at round-off level. Called when the ratio of successive
 * increments is at least 1/2. A stiff spring k has a round-off of epsilon k |q| in its force, and
 * dt epsilon k |q| may exceed a small momentum. Perturbing state and guess by 2 ulp estimates the
 * round-off of the residual. The residual is evaluated at the starting values, because its
 * round-off at a diverged iterate is meaningless.
 */
static int is_round_off(work_t *w, real dt, const real q[N], const real p[N], real size)
{
    real q_near[N], p_near[N], rounding = 0;
    unsigned seed = 1;
    if (size <= 64*epsilon)
        return 1;
    euler_start(w, dt, q, p, w->x_near);
    residual(w, dt, q, p, w->x_near, w->r_near);
    size = increment_size(w, dt, q, p, w->x_near, w->r);
    for (int e = 0; e < U; ++e)
        w->r[e] = w->r_near[e];
    for (int attempt = 0; attempt < 4; ++attempt) {
        for (int a = 0; a < N; ++a) {
            q_near[a] = q[a] + perturbation(&seed)*q[a];
            p_near[a] = p[a] + perturbation(&seed)*p[a];
        }
        for (int e = 0; e < U; ++e)
            w->x_near[e] += perturbation(&seed)*w->x_near[e];
        residual(w, dt, q_near, p_near, w->x_near, w->r_near);
        for (int e = 0; e < U; ++e)
            w->r_near[e] -= w->r[e];
        euler_start(w, dt, q, p, w->x_near);
        rounding = larger(rounding, residual_size(w, dt, q, p, w->x_near, w->r_near));
    }
    return size <= 16*rounding;
}

/* Failure status of an iteration, from its last increment and the last ratio of increments. */
static int failure_status(real size, real ratio)
{
    if (!isfinite(size))
        return NOT_FINITE;
    return ratio < (real)0.5 ? NOT_CONVERGED : size < (real)0.001 ? STAGNATED : DIVERGED;
}

/*
 * Newton's method x <- x - J^-1 r from the guess in x. The convergence test accepts an increment
 * below the tolerance, an increment whose successor would be below round-off (quadratic
 * convergence predicts size (size/previous)^2), or a stagnation at round-off level.
 */
static int iterate(work_t *w, const options_t *options, real dt, const real q[N], const real p[N],
    real x[U], int *iterations)
{
    const int first = *iterations + 1;
    real size = 0, ratio = 0;
#if GS_CONDENSED
    int has_factors = 0;
#endif
    while (*iterations < options->max_iterations) {
        residual(w, dt, q, p, x, w->r);
#if GS_CONDENSED
        /* The last factors contract by ratio^2; the next increment is size ratio^2, as below. */
        has_factors = ratio > 0 && ratio < (real)0.5
            && (has_factors || size*ratio*ratio*ratio*ratio < epsilon/64);
        int status = has_factors ? OK : factorise_jacobian(w, dt, q, p, x);
        w->effort -= has_factors ? JACOBIAN_COST + w->products/2 : 0;
#else
        int status = factorise_jacobian(w, dt, q, p, x);
#endif
        if (status == OK)
            status = solve_jacobian(w, dt, w->r);
        if (status != OK)
            return status;
        ++*iterations;
        w->effort += RESIDUAL_COST + JACOBIAN_COST + w->products/2;
        const real previous = size;
        size = increment_size(w, dt, q, p, x, w->r);
        w->increment = size;
        for (int e = 0; e < U; ++e)
            x[e] -= w->r[e];
        if (!isfinite(norm(U, w->r))) /* `size` may be infinite: a body at rest */
            return *iterations == first ? NOT_FINITE : DIVERGED;
        if (size <= options->tolerance)
            return satisfies_constraints(w, dt, q, x);
        if (*iterations == first)
            continue;
        const int shrinks = ratio < (real)0.5; /* a small ratio after stagnation is coincidence */
        ratio = size/previous;
        if (ratio >= (real)0.5 && is_round_off(w, dt, q, p, size))
            return satisfies_constraints(w, dt, q, x);
        if (!(options->tolerance > 0) && shrinks && size < (real)0.001 && ratio < (real)0.1
            && size*ratio*ratio < epsilon/64)
            return satisfies_constraints(w, dt, q, x);
    }
    return failure_status(size, ratio);
}

/*
 * Solves T1 from the explicit Euler start. A stiff force times dt may exceed the momentum by orders
 * of magnitude and the iteration may then diverge; the second attempt starts from zero forces.
 */
static int newton(work_t *w, const options_t *options, real dt, const real q[N], const real p[N],
    real x[U], int *iterations)
{
    *iterations = 0;
    euler_start(w, dt, q, p, x);
    const int status = iterate(w, options, dt, q, p, x, iterations);
    if (status == OK || *iterations >= options->max_iterations)
        return status;
    euler_start(w, dt, q, p, x);
    zero_force_start(x);
    const int second = iterate(w, options, dt, q, p, x, iterations);
    return second == OK || status == NOT_FINITE ? second : status;
}

#endif
