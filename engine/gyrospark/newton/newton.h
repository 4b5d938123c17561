/* T1 by Newton's method. */
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

#if GS_ELEMENTS
/* The Jacobian of T1 as a band, its factors in its place. */
static int factorise_jacobian(work_t *w)
{
    return band_factorise(w->J, w->exponents, w->pivots, &w->products);
}

/* b <- J^-1 b from the factors */
static int solve_jacobian(work_t *w, real b[U])
{
    return band_substitute(w->J, w->exponents, w->pivots, b, w->forward);
}
#else
/* The Jacobian of T1 as U rows of U, its factors in its place. */
static int factorise_jacobian(work_t *w)
{
    return lu_factorise(U, w->J, w->exponents, w->pivots, &w->products);
}

/* b <- J^-1 b from the factors */
static int solve_jacobian(work_t *w, real b[U])
{
    return lu_substitute(U, w->J, w->exponents, w->pivots, b);
}
#endif

#if GS_CONSTRAINED
/*
 * Small increments of huge unknowns are no solution: the constraints at the end of the step tell.
 */
static int satisfies_constraints(work_t *w, real dt, const real q[N], const real x[U])
{
    real d[N], q1[N], g[M], dg[M], reach[M];
    displacement(dt, x, d);
    for (int a = 0; a < N; ++a)
        q1[a] = q[a] + d[a];
    constraint(AT(&w->constants, w->t), q, g);
    constraint_increment(BETWEEN(&w->constants, w->t, w->step), q, d, dg);
    constraint_reach(AT(&w->constants, w->t + w->step), q1, reach);
    const real tolerance = norm(N, d)/1000 + 64*epsilon*norm(N, q);
    for (int mu = 0; mu < M; ++mu) {
        const real allowed = MATH(fabs)(g[mu]) + reach[mu]*tolerance;
        if (!(MATH(fabs)(g[mu] + dg[mu]) <= allowed))
            return isfinite(allowed) ? DIVERGED : NOT_FINITE;
    }
    return OK;
}
#else
/* Without constraints a small increment is a solution. */
static int satisfies_constraints(work_t *w, real dt, const real q[N], const real x[U])
{
    (void)w, (void)dt, (void)q, (void)x;
    return OK;
}
#endif

/*
 * Whether the increment in w->r, no smaller than half the one before, is so by rounding. A stiff
 * spring k rounds its force by epsilon k |q|, and dt times that may be large beside a small
 * momentum: states and guesses two units in the last place away tell by how much the residual is
 * uncertain. They are those at the start of the step, for an iteration that has gone astray proves
 * nothing.
 */
static int is_round_off(work_t *w, real dt, const real q[N], const real p[N], real size)
{
    real q_near[N], p_near[N], rounding = 0;
    unsigned chance = 1;
    if (size <= 64*epsilon)
        return 1;
    euler_start(w, dt, q, p, w->x_near);
    residual(w, dt, q, p, w->x_near, w->r_near);
    size = increment_size(w, dt, q, p, w->x_near, w->r);
    for (int e = 0; e < U; ++e)
        w->r[e] = w->r_near[e];
    for (int attempt = 0; attempt < 4; ++attempt) {
        for (int a = 0; a < N; ++a) {
            q_near[a] = q[a] + perturbation(&chance)*q[a];
            p_near[a] = p[a] + perturbation(&chance)*p[a];
        }
        for (int e = 0; e < U; ++e)
            w->x_near[e] += perturbation(&chance)*w->x_near[e];
        residual(w, dt, q_near, p_near, w->x_near, w->r_near);
        for (int e = 0; e < U; ++e)
            w->r_near[e] -= w->r[e];
        euler_start(w, dt, q, p, w->x_near);
        rounding = larger(rounding, residual_size(w, dt, q, p, w->x_near, w->r_near));
    }
    return size <= 16*rounding;
}

/* Why iterations end without a solution, by the last increment and its ratio to the one before. */
static int failure_status(real size, real ratio)
{
    if (!isfinite(size))
        return NOT_FINITE;
    return ratio < (real)0.5 ? NOT_CONVERGED : size < (real)0.001 ? STAGNATED : DIVERGED;
}

/*
 * Iterates x <- x - J^-1 r from the guess in x. It ends when the increment is below the
 * tolerance, when the next one would be below round-off (quadratic convergence: about
 * size (size/previous)^2), or when increments have stopped shrinking where rounding stops them.
 */
static int iterate(work_t *w, const options_t *options, real dt, const real q[N], const real p[N],
    real x[U], int *iterations)
{
    const int first = *iterations + 1;
    real size = 0, ratio = 0;
    while (*iterations < options->max_iterations) {
        residual(w, dt, q, p, x, w->r);
        jacobian(w, dt, q, p, x, w->J);
        int status = factorise_jacobian(w);
        if (status == OK)
            status = solve_jacobian(w, w->r);
        if (status != OK)
            return status;
        ++*iterations;
        w->effort += RESIDUAL_COST + JACOBIAN_COST + w->products/2;
        const real previous = size;
        size = increment_size(w, dt, q, p, x, w->r);
        w->increment = size;
        for (int e = 0; e < U; ++e)
            x[e] -= w->r[e];
        if (!isfinite(norm(U, w->r))) /* the size is infinite where a body at rest begins to move */
            return NOT_FINITE;
        if (size <= options->tolerance)
            return satisfies_constraints(w, dt, q, x);
        if (*iterations == first)
            continue;
        const int shrinks = ratio < (real)0.5; /* a small one after one that stalled is chance */
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
 * The unknowns from the rates at the start of the step. A stiff force, by dt, may be many times the
 * momentum there: where that leads astray, once more from a momentum that stays.
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
    return iterate(w, options, dt, q, p, x, iterations) == OK ? OK : status;
}

#endif
