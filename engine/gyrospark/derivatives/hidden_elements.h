/* Element templates: the hidden constraints f = G v + g_t, v = H_p, and transposed band solutions. */
#ifndef GS_DERIVATIVES_HIDDEN_ELEMENTS_H
#define GS_DERIVATIVES_HIDDEN_ELEMENTS_H

#include "gyrospark/linear_algebra/band_lu.h"

/* b <- J^-T b from the factors; b is in the scheme's order, `forward` is work space. */
static void band_substitute_transposed(const real *restrict J, const int *restrict pivots,
    real *restrict b, real *restrict forward)
{
    for (int e = 0; e < U; ++e)
        forward[position[e]] = b[e];
    for (int k = 0; k < U; ++k) {
        const real *upper = band_row((real *)J, BAND, k);
        const real value = forward[k] /= upper[k];
        for (int j = k + 1; j <= pivots[U + k]; ++j)
            forward[j] -= upper[j]*value;
    }
    for (int k = U - 1; k >= 0; --k) {
        const real *lower = band_lower((real *)J, U, BAND, k) + k + 1;
        const real value = forward[k] - sum_products(pivots[2*U + k] - k, lower, forward + k + 1);
        forward[k] = forward[pivots[k]];
        forward[pivots[k]] = value;
    }
    for (int e = 0; e < U; ++e)
        b[e] = forward[position[e]];
}

#if GS_CONSTRAINED
/*
 * A state on the constraints: the factors of W = G H_pp G^T, and the derivatives of f = G v + g_t,
 * v = H_p. H_p depends on the time among the constants alone.
 */
typedef struct {
    real W[FACTOR];
    rates_matrices rates;
    constraint_value_matrices value;
    constraint_velocity_matrices velocity;
} hidden_t;

/* Evaluates a state (q, p) on the constraints; returns SINGULAR if W is not finite. */
static int linearise_hidden(const constants *c, const real q[N], const real p[N], hidden_t *s)
{
    const real t = 0;
    real v[N];
    velocity(c, q, p, v);
    schur(c, q, p, s->W);
    factor(s->W);
    evaluate_rates(c, q, p, &t, 0, &s->rates);
    evaluate_constraint_value(c, q, &s->value);
    evaluate_constraint_velocity(c, q, v, &s->velocity);
    return isfinite(norm(FACTOR, s->W)) ? OK : SINGULAR;
}

/* df += G dv + d(G v + g_t), with dv the derivative of H_p */
static void add_hidden_times(const hidden_t *s, const real *dq, const real *dp, const real *dc,
    real *df)
{
    real force[N] = { 0 }, dv[N] = { 0 };
    rates_times(&s->rates, dq, dp, dc, force, dv);
    constraint_value_times(&s->value, dv, NULL, df);
    constraint_velocity_times(&s->velocity, dq, dc, df);
}

/* The transpose of add_hidden_times, added to (q, p, c_bar) */
static void add_hidden_transposed(const hidden_t *s, const real *f, real *q, real *p, real *c_bar)
{
    const real force[N] = { 0 };
    real v_bar[N] = { 0 };
    constraint_value_transposed(&s->value, f, v_bar, NULL);
    rates_transposed(&s->rates, force, v_bar, q, p, c_bar);
    constraint_velocity_transposed(&s->velocity, f, q, c_bar);
}
#endif

#endif
