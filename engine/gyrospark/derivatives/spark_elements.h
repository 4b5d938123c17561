/*
 * SPARK methods: the linearisation of a step of a system of element templates. Products are sums
 * over instances, evaluated again for each direction; J is a band matrix.
 */
#ifndef GS_DERIVATIVES_SPARK_ELEMENTS_H
#define GS_DERIVATIVES_SPARK_ELEMENTS_H

#include "gyrospark/derivatives/hidden_elements.h"

/* States at which the derivatives of one step are evaluated; its band matrix is in the work memory. */
typedef struct {
    real h, t;
    const real *x;
    real q_rate[S][N], p_rate[S][N], node_rate[P + 1][N], end_rate[N];
    constants c;
    work_t *w;
#if GS_CONSTRAINED
    const real *lambda; /* multipliers of the nodes 0..P - 1 */
    real impulse[M]; /* mu of the projection */
    hidden_t hidden;
#endif
} linearisation_t;

static int linearise(const constants *c, real t, real h, const real q[N], const real p[N],
    const real x[U], const real q1[N], const real p1[N], linearisation_t *l)
{
    work_t *w = l->w;
    real p_end[N];
    l->h = h;
    l->t = t;
    l->x = x;
    l->c = w->constants = *c;
    w->t = t;
    IF_TIME(w->step = h;)
    stage_values(w, h, q, p, x);
    for (int a = 0; a < N; ++a) {
        for (int i = 0; i < S; ++i) {
            l->q_rate[i][a] = l->p_rate[i][a] = 0;
            for (int j = 0; j < S; ++j) {
                l->q_rate[i][a] += tableau.A[i][j]*x[j*N + a];
                l->p_rate[i][a] += tableau.A_hat[i][j]*x[K_HAT + j*N + a];
            }
            for (int k = 0; k < ACTING; ++k)
                l->p_rate[i][a] -= tableau.A_tilde[i][k]*w->force[k][a];
        }
        l->end_rate[a] = 0;
        for (int j = 0; j < S; ++j)
            l->end_rate[a] += tableau.b_hat[j]*x[K_HAT + j*N + a];
        for (int k = 0; k < ACTING; ++k)
            l->end_rate[a] -= tableau.b_tilde[k]*w->force[k][a];
        for (int k = 0; k <= P; ++k) {
            l->node_rate[k][a] = 0;
            for (int j = 0; j < S; ++j)
                l->node_rate[k][a] += tableau.A_bar[k][j]*x[j*N + a];
        }
        p_end[a] = p[a] + h*l->end_rate[a];
    }
    jacobian(w, h, q, p, x, w->J);
    w->constants = *c;
#if GS_CONSTRAINED
    const int status = linearise_hidden(AT(&l->c, t + h), q1, p1, &l->hidden);
    if (status != OK)
        return status;
    l->lambda = x + LAMBDA;
    impulse_between(AT(&l->c, t + h), &l->hidden, p_end, p1, l->impulse);
#else
    (void)q1, (void)p1, (void)p_end;
#endif
    return band_factorise(w->J, w->exponents, w->pivots, &w->products);
}

static void stage_times(linearisation_t *l, int i, const real dq[N], const real dp[N],
    const real dc[E], real force[N], real velocity[N])
{
    const real t = l->t + l->h*tableau.c[i];
    rates_times(AT(&l->c, t), l->w->stage_q[i], l->w->stage_p[i], &t, dq, dp, dc, 1, force,
        velocity);
}

static void stage_transposed(linearisation_t *l, int i, const real force[N],
    const real velocity[N], real q[N], real p[N], real c[E])
{
    const real t = l->t + l->h*tableau.c[i];
    rates_transposed(AT(&l->c, t), l->w->stage_q[i], l->w->stage_p[i], &t, force, velocity, 1, q,
        p, c);
}

#if GS_CONSTRAINED
/* The constants at the time of node k */
static const constants *node_constants(linearisation_t *l, int k)
{
    (void)k;
    return AT(&l->c, l->t + l->h*tableau.c_tilde[k]);
}

/* Lambda of a node; of the last one the impulse */
static const real *multipliers_of(const linearisation_t *l, int k)
{
    return k < P ? l->lambda + k*M : l->impulse;
}

static void force_times(linearisation_t *l, int k, const real dq[N], const real dc[E],
    real force[N])
{
    constraint_force_times(node_constants(l, k), l->w->Q_tilde[k], multipliers_of(l, k), dq, dc,
        force);
}

static void force_transposed(linearisation_t *l, int k, const real force[N], real q[N], real c[E])
{
    constraint_force_transposed(node_constants(l, k), l->w->Q_tilde[k], multipliers_of(l, k), force,
        q, c);
}

static void constraint_times(linearisation_t *l, int k, const real dq[N], const real *dc,
    real dg[M])
{
    constraint_value_times(node_constants(l, k), l->w->Q_tilde[k], dq, dc, dg);
}

static void constraint_transposed(linearisation_t *l, int k, const real g[M], real q[N], real *c)
{
    constraint_value_transposed(node_constants(l, k), l->w->Q_tilde[k], g, q, c);
}

static void hidden_times(linearisation_t *l, const real dq[N], const real dp[N], const real dc[E],
    real df[M])
{
    add_hidden_times(node_constants(l, P), &l->hidden, dq, dp, dc, df);
}

static void hidden_transposed(linearisation_t *l, const real f[M], real q[N], real p[N], real c[E])
{
    add_hidden_transposed(node_constants(l, P), &l->hidden, f, q, p, c);
}

/* W = G H_pp G^T is symmetric. */
static void solve_hidden(linearisation_t *l, real b[M])
{
    substitute(l->hidden.W, b);
}

static void solve_hidden_transposed(linearisation_t *l, real b[M])
{
    substitute(l->hidden.W, b);
}
#endif

#endif
