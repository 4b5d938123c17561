/*
 * Implicit midpoint (IMS) and energy-momentum (EMS) schemes: the linearisation of a step of a system
 * of element templates. Products are sums over instances; J is a band matrix.
 */
#ifndef GS_DERIVATIVES_MIDPOINT_ELEMENTS_H
#define GS_DERIVATIVES_MIDPOINT_ELEMENTS_H

#include "gyrospark/derivatives/hidden_elements.h"

/* The derivatives of one step; the band matrix J is in the work memory, once it is factorised. */
typedef struct {
    real h;
    const real *q, *p, *x;
    constants c;
    work_t *w;
    int is_factorised;
    mean_rates_matrices rates;
#if GS_CONSTRAINED
    constraint_value_matrices value; /* at the end of the step */
    mean_constraint_force_matrices force;
#endif
} linearisation_t;

/* Evaluates the matrices of a step. l->w is set before; q, p and x must live as long as l. */
static int linearise(const constants *c, real t, real h, const real q[N], const real p[N],
    const real x[U], const real q1[N], const real p1[N], linearisation_t *l)
{
    work_t *w = l->w;
    (void)q1, (void)p1;
    l->h = h;
    l->q = q;
    l->p = p;
    l->x = x;
    l->is_factorised = 0;
    l->c = w->constants = *c;
    w->t = t;
    IF_TIME(w->step = h;)
    mean_values(w, q, p, x);
    const real middle = t + h/2;
    const constants *at_mean = BETWEEN(&w->constants, t, h);
    evaluate_mean_rates(at_mean, w->q_mean, w->p_mean, x, x + DP, &middle, 1, &l->rates);
#if GS_CONSTRAINED
    evaluate_mean_constraint_force(at_mean, w->q_mean, x, x + LAMBDA, &l->force);
    evaluate_constraint_value(AT(&w->constants, t + h), q1, &l->value);
#endif
    return OK;
}

/* The products of midpoint_dense.h, as sums over instances, and their transposes */
static void mean_times(linearisation_t *l, const real dq[N], const real dp[N], const real dc[E],
    real force[N], real velocity[N])
{
    mean_rates_times(&l->rates, dq, dp, dc, force, velocity);
#if GS_CONSTRAINED
    mean_constraint_force_times(&l->force, dq, dc, force);
#endif
}

static void mean_transposed(linearisation_t *l, const real force[N], const real velocity[N],
    real q[N], real p[N], real c_bar[E])
{
    mean_rates_transposed(&l->rates, force, velocity, q, p, c_bar);
#if GS_CONSTRAINED
    mean_constraint_force_transposed(&l->force, force, q, c_bar);
#endif
}

#if GS_CONSTRAINED
static void constraint_times(linearisation_t *l, int k, const real dq[N], const real dc[E],
    real dg[M])
{
    (void)k;
    constraint_value_times(&l->value, dq, dc, dg);
}

static void constraint_transposed(linearisation_t *l, int k, const real g[M], real q[N], real c[E])
{
    (void)k;
    constraint_value_transposed(&l->value, g, q, c);
}
#endif

#endif
