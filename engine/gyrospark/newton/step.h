/* A step by Newton's method, and public functions for its phases and its residual. */
#ifndef GS_NEWTON_STEP_H
#define GS_NEWTON_STEP_H

#include "gyrospark/newton/newton.h"
#include "gyrospark/run/record.h"

#if GS_FRAME
#include "gyrospark/frames/rotation.h"
#endif

#if GS_EXACT_ENERGY
/* Error of the energy at the end (q1, p1) of the step with unknowns x: H(q1, p1) - H_0 - work. */
static real energy_error(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    const real q1[N], const real p1[N])
{
    (void)dt, (void)q, (void)p, (void)x; /* without forces */
    const real gain = hamiltonian(AT(&w->constants, w->t + w->step), q1, p1) - w->energy_target;
    return gain IF_FORCES(- step_work(w, dt, q, p, x));
}

#endif

/* Advances (q, p) by one step to (q1, p1), with theta for w->energy_target; needs w->constants. */
static int advance(work_t *w, const options_t *options, real dt, const real q[N], const real p[N],
    real q1[N], real p1[N], real multipliers[ROOM], int *iterations)
{
    real q_end[N], p_end[N];
#if GS_EXACT_ENERGY
    static const real zero[2] = { 0 };
    int count, another;
    set_theta(w, zero);
#endif
    int status = newton(w, options, dt, q, p, w->x, iterations);
    if (status == OK)
        status = finish(w, dt, q, p, w->x, q_end, p_end, multipliers);
    if (status != OK)
        return status;
#if GS_EXACT_ENERGY
    energy_search_t search = begin_energy_search(w->energy_target, dt, q, p, q_end, p_end);
    do {
        another = next_theta(&search, energy_error(w, dt, q, p, w->x, q_end, p_end));
        if (!set_theta(w, search.theta))
            continue;
        count = 0;
        status = iterate(w, options, dt, q, p, w->x, &count);
        *iterations += count;
        if (status != OK) {
            another = give_up(&search);
            set_theta(w, zero);
            status = newton(w, options, dt, q, p, w->x, &count);
            *iterations += count;
        }
        if (status == OK)
            status = finish(w, dt, q, p, w->x, q_end, p_end, multipliers);
        if (status != OK)
            return status;
    } while (another);
    w->energy_waits = search.waits;
#endif
    IF_FORCES(w->work_done = step_work(w, dt, q, p, w->x);) /* until the step is accepted */
    for (int a = 0; a < N; ++a) {
        q1[a] = q_end[a];
        p1[a] = p_end[a];
    }
    return OK;
}

#if !GS_PROFILE_RUN
int NAME(T1)(const parameters_t *parameters, const options_t *options, real dt, const real q[N],
    const real p[N], real x[U], int *iterations, work_t *work)
{
    begin_step(work, parameters, dt);
    return newton(work, options, dt, q, p, x, iterations);
}

/* In a frame x refers to the one that coincides with space at the start of the step. */
int NAME(T2)(const parameters_t *parameters, real dt, const real q[N], const real p[N],
    const real x[U], real q1[N], real p1[N], real multipliers[ROOM], work_t *work)
{
    begin_step(work, parameters, dt);
    const int status = finish(work, dt, q, p, x, q1, p1, multipliers);
    IF_FRAME(if (status == OK)
        rotate_step(parameters, dt, q1, p1, multipliers);)
    return status;
}

void NAME(guess)(const parameters_t *parameters, real dt, const real q[N], const real p[N],
    real x[U], work_t *work)
{
    begin_step(work, parameters, dt);
    euler_start(work, dt, q, p, x);
}

void NAME(residual)(const parameters_t *parameters, real dt, const real q[N], const real p[N],
    const real x[U], real r[U], work_t *work)
{
    begin_step(work, parameters, dt);
    residual(work, dt, q, p, x, r);
}

/* Copies J to dense row-major storage, in the order of the unknowns. */
static void spread_jacobian(const real *J, real *dense)
{
#if GS_ELEMENTS
    band_spread(J, dense);
#else
    for (int e = 0; e < U*U; ++e)
        dense[e] = J[e];
#endif
}

void NAME(jacobian)(const parameters_t *parameters, real dt, const real q[N], const real p[N],
    const real x[U], real J[(size_t)U*U], work_t *work)
{
    begin_step(work, parameters, dt);
    residual(work, dt, q, p, x, work->r);
    jacobian(work, dt, q, p, x, work->J);
    spread_jacobian(work->J, J);
}

real NAME(increment_size)(real dt, const real q[N], const real p[N], const real x[U],
    const real dx[U], const work_t *work)
{
    return increment_size(work, dt, q, p, x, dx);
}

int NAME(satisfies_constraints)(real dt, const real q[N], const real x[U], work_t *work)
{
    return satisfies_constraints(work, dt, q, x);
}

real NAME(last_increment)(const work_t *work)
{
    return work->increment;
}
#endif

#endif
