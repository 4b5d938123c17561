/*
 * Implicit midpoint (IMS) and energy-momentum (EMS) schemes: the linearisation of a step of a system
 * of element templates. Products are sums over instances; J is a band matrix.
 */
#ifndef GS_DERIVATIVES_MIDPOINT_ELEMENTS_H
#define GS_DERIVATIVES_MIDPOINT_ELEMENTS_H

#include "gyrospark/derivatives/hidden_elements.h"

/* The step that is linearised; its band matrix is in the work memory. */
typedef struct {
    real h, t, q1[N];
    const real *x;
    constants c;
    work_t *w;
} linearisation_t;

static int linearise(const constants *c, real t, real h, const real q[N], const real p[N],
    const real x[U], const real q1[N], const real p1[N], linearisation_t *l)
{
    work_t *w = l->w;
    (void)p1;
    l->h = h;
    l->t = t;
    l->x = x;
    l->c = w->constants = *c;
    w->t = t;
    IF_TIME(w->step = h;)
    for (int a = 0; a < N; ++a)
        l->q1[a] = q1[a];
    mean_values(w, q, p, x);
    jacobian(w, h, q, p, x, w->J);
    w->constants = *c;
    return band_factorise(w->J, w->exponents, w->pivots, &w->products);
}

static void mean_times(linearisation_t *l, const real dq[N], const real dp[N], const real dc[E],
    real force[N], real velocity[N])
{
    const work_t *w = l->w;
    const real middle = l->t + l->h/2;
    const constants *c = BETWEEN(&l->c, l->t, l->h);
    mean_rates_times(c, w->q_mean, w->p_mean, l->x, l->x + DP, &middle, dq, dp, dc, 1, force,
        velocity);
#if GS_CONSTRAINED
    mean_constraint_force_times(c, w->q_mean, l->x, l->x + LAMBDA, dq, dc, force);
#endif
}

static void mean_transposed(linearisation_t *l, const real force[N], const real velocity[N],
    real q[N], real p[N], real c_bar[E])
{
    const work_t *w = l->w;
    const real middle = l->t + l->h/2;
    const constants *c = BETWEEN(&l->c, l->t, l->h);
    mean_rates_transposed(c, w->q_mean, w->p_mean, l->x, l->x + DP, &middle, force, velocity, 1,
        q, p, c_bar);
#if GS_CONSTRAINED
    mean_constraint_force_transposed(c, w->q_mean, l->x, l->x + LAMBDA, force, q, c_bar);
#endif
}

#if GS_CONSTRAINED
static void constraint_times(linearisation_t *l, int k, const real dq[N], const real dc[E],
    real dg[M])
{
    (void)k;
    constraint_value_times(AT(&l->c, l->t + l->h), l->q1, dq, dc, dg);
}

static void constraint_transposed(linearisation_t *l, int k, const real g[M], real q[N], real c[E])
{
    (void)k;
    constraint_value_transposed(AT(&l->c, l->t + l->h), l->q1, g, q, c);
}
#endif

#endif
