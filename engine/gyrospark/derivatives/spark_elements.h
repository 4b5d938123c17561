/*
 * SPARK methods: the linearisation of a step of a system of element templates. Products are sums
 * over instances, whose matrices are evaluated once; J is a band matrix, where it is factorised.
 */
#ifndef GS_DERIVATIVES_SPARK_ELEMENTS_H
#define GS_DERIVATIVES_SPARK_ELEMENTS_H

#include "gyrospark/derivatives/hidden_elements.h"

/* The derivatives of one step; the band matrix J is in the work memory, once it is factorised. */
typedef struct {
    real h;
    const real *q, *p, *x;
    real q_rate[S][N], p_rate[S][N], node_rate[P + 1][N], end_rate[N];
    constants c;
    work_t *w;
    int is_factorised;
    real right_side[U], rest[U], increment[U], product[U]; /* work memory of the iteration */
    rates_matrices rates[S];
#if GS_CONSTRAINED
    constraint_value_matrices value[P + 1];
    constraint_force_matrices force[P + 1];
    real W[P][FACTOR]; /* factors of W = G H_pp G^T of the nodes 0..P - 1 */
    real impulse[M];   /* mu of the projection */
    hidden_t hidden;
#endif
} linearisation_t;

#if GS_CONSTRAINED
/* mu <- W^-1 f_p (before - p): the impulse of the projection along G^T from `before` to p */
static void impulse_between(const hidden_t *s, const real before[N], const real p[N], real mu[M])
{
    const real zero[N] = { 0 };
    real change[N];
    for (int a = 0; a < N; ++a)
        change[a] = before[a] - p[a];
    for (int m = 0; m < M; ++m)
        mu[m] = 0;
    add_hidden_times(s, zero, change, NULL, mu);
    substitute(s->W, mu);
}
#endif

/* Evaluates the matrices of a step. l->w is set before; q, p and x must live as long as l. */
static int linearise(const constants *c, real t, real h, const real q[N], const real p[N],
    const real x[U], const real q1[N], const real p1[N], linearisation_t *l)
{
    work_t *w = l->w;
    real p_end[N];
    l->h = h;
    l->q = q;
    l->p = p;
    l->x = x;
    l->is_factorised = 0;
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
    for (int i = 0; i < S; ++i) {
        const real now = t + h*tableau.c[i];
        evaluate_rates(AT(&l->c, now), w->stage_q[i], w->stage_p[i], &now, 1, &l->rates[i]);
    }
#if GS_CONSTRAINED
    const int status = linearise_hidden(AT(&l->c, t + h), q1, p1, &l->hidden);
    if (status != OK)
        return status;
    impulse_between(&l->hidden, p_end, p1, l->impulse);
    for (int k = 0; k <= P; ++k) {
        const constants *at = AT(&l->c, t + h*tableau.c_tilde[k]);
        evaluate_constraint_value(at, w->Q_tilde[k], &l->value[k]);
        evaluate_constraint_force(at, w->Q_tilde[k], k < P ? x + LAMBDA + k*M : l->impulse,
            &l->force[k]);
        if (k < P) {
            schur(at, w->Q_tilde[k], p, l->W[k]);
            factor(l->W[k]);
        }
    }
#else
    (void)q1, (void)p1, (void)p_end;
#endif
    return OK;
}

/* The products of spark_dense.h, as sums over instances, and their transposes */
static void stage_times(linearisation_t *l, int i, const real dq[N], const real dp[N],
    const real *dc, real force[N], real velocity[N])
{
    rates_times(&l->rates[i], dq, dp, dc, force, velocity);
}

static void stage_transposed(linearisation_t *l, int i, const real force[N],
    const real velocity[N], real q[N], real p[N], real *c)
{
    rates_transposed(&l->rates[i], force, velocity, q, p, c);
}

#if GS_CONSTRAINED
static void force_times(linearisation_t *l, int k, const real dq[N], const real *dc, real force[N])
{
    constraint_force_times(&l->force[k], dq, dc, force);
}

static void force_transposed(linearisation_t *l, int k, const real force[N], real q[N], real *c)
{
    constraint_force_transposed(&l->force[k], force, q, c);
}

static void constraint_times(linearisation_t *l, int k, const real dq[N], const real *dc,
    real dg[M])
{
    constraint_value_times(&l->value[k], dq, dc, dg);
}

static void constraint_transposed(linearisation_t *l, int k, const real g[M], real q[N], real *c)
{
    constraint_value_transposed(&l->value[k], g, q, c);
}

static void hidden_times(linearisation_t *l, const real dq[N], const real dp[N], const real dc[E],
    real df[M])
{
    add_hidden_times(&l->hidden, dq, dp, dc, df);
}

static void hidden_transposed(linearisation_t *l, const real f[M], real q[N], real p[N], real c[E])
{
    add_hidden_transposed(&l->hidden, f, q, p, c);
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
