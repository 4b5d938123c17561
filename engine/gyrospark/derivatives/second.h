/*
 * Public functions: the derivative of an adjoint along a direction, by the adjoint on dual numbers.
 *
 * The unknowns x of a step move by dx, the solution of the linearised equations; with x + dx as dual
 * numbers the linearisation and the adjoint of the step have their derivatives as slopes.
 */
#ifndef GS_DERIVATIVES_SECOND_H
#define GS_DERIVATIVES_SECOND_H

#include "gyrospark/derivatives/dual_numbers.h"
#include "gyrospark/derivatives/steps.h"

/* Memory, ALIGNED in the caller's memory. */
typedef struct {
    derivatives_t first;
    dual_constants c;
    dual_linearisation_t l;
    dual chain[CHAIN + 1], w[2*N], z[Z];
} second_t;

size_t NAME(second_size)(void)
{
    return sizeof(second_t) + 64;
}

/* The constants of the run and their slopes; the chain with its own. */
static void prepare_second(const parameters_t *parameters, const real *dz, second_t *d)
{
    dual par[PARAMETERS + 1];
    prepare_derivatives(parameters, &d->first);
    dual_parameters(parameters, dz + 2*N, slope_unit(), par);
    dual_constants_by_parameters(par, d->chain);
}

/* The dual numbers x + dx */
static void set_duals(int n, const real *x, const real *dx, dual *duals)
{
    for (int e = 0; e < n; ++e)
        duals[e] = make_dual(x[e], slope_unit()*dx[e]);
}

/* The adjoint of a step from row 0 of q and p to row 1, of the dual cotangent w, along z. */
static int second_of_step(second_t *d, real t, real h, const real *q, const real *p,
    const real *x, const real z[Z])
{
    dual q0[N], p0[N];
    const real unit = slope_unit();
    const dual start = make_dual(t, unit*z[DT0]), step = make_dual(h, unit*z[DH]);
    set_dual_constants(&d->c, &d->first.work.constants, unit, z + 2*N);
    set_duals(N, q, z, q0);
    set_duals(N, p, z + N, p0);
#if GS_SPLITTING
    (void)x;
    int status = dual_linearise(&d->c, start, step, q0, p0, &d->first.l, &d->l);
#else
    real dx[U], dz1[2*N];
    dual q1[N], p1[N], unknowns[U];
    int status = step_tangent(&d->first.l, z, dx, dz1, NULL);
    if (status != OK)
        return status;
    set_duals(N, q + N, dz1, q1);
    set_duals(N, p + N, dz1 + N, p1);
    set_duals(U, x, dx, unknowns);
    status = dual_linearise(&d->c, start, step, q0, p0, unknowns, q1, p1, &d->l);
#endif
    if (status == OK)
        status = dual_step_adjoint(&d->l, d->w, NULL, d->z);
    return status;
}

/*
 * The steps first..first + steps - 1 backwards, as of integrate_adjoint, with derivatives along the
 * direction whose rows q and p at the start of each step are in `tangents`, the others in dz.
 */
int NAME(integrate_second)(const parameters_t *parameters, IF_INPUTS(const real *inputs, long hold,
    const real *inputs_slope, real *inputs_bar, real *inputs_bar_slope,) real dt, long first,
    long steps, const real *q, const real *p, const real *x, const real *tangents, const real *dz,
    const real *cotangents, const real *cotangents_slope, long every, real *w, real *w_slope,
    real *z_bar, real *z_bar_slope, void *memory)
{
    second_t *d = ALIGNED(memory);
    const real unit = slope_unit();
    IF_INPUTS(const inputs_t own = { inputs, hold, 0 };)
    prepare_second(parameters, dz, d);
    const real start = start_time(parameters);
    set_duals(2*N, w, w_slope, d->w);
    for (long j = steps - 1; j >= 0; --j) {
        const long step = first + j;
        int status = linearise_steps(&d->first, IF_INPUTS(&own,) step, start, dt, 1, q + j*N,
            p + j*N, x + j*U, 2*N);
        real *z = d->first.z;
        to_constants(&d->first, dz, 1, z);
        z[DT0] += (real)step*z[DH];
        for (int a = 0; a < 2*N; ++a)
            z[a] = tangents[j*2*N + a];
#if GS_INPUTS
        for (int i = 0; i < INPUTS && inputs != NULL; ++i)
            if (input_constant[i] >= 0)
                z[2*N + input_constant[i]] = inputs_slope[j*INPUTS + i];
#endif
        if (status == OK)
            status = second_of_step(d, start + (real)step*dt, dt, q + j*N, p + j*N, x + j*U, z);
        if (status != OK)
            return status;
        d->z[DH] += (real)step*d->z[DT0];
#if GS_INPUTS
        for (int i = 0; i < INPUTS && inputs != NULL; ++i) {
            const int place = input_constant[i];
            inputs_bar[j*INPUTS + i] = place < 0 ? 0 : value_of(d->z[2*N + place]);
            inputs_bar_slope[j*INPUTS + i] = place < 0 ? 0
                : scaled_slope_of(d->z[2*N + place])/unit;
            if (place >= 0)
                d->z[2*N + place] = 0;
        }
#endif
        for (int i = 0; i < CHAIN; ++i) {
            const dual share = d->chain[i]*d->z[2*N + chain_constant[i]];
            z_bar[2*N + chain_parameter[i]] += value_of(share);
            z_bar_slope[2*N + chain_parameter[i]] += scaled_slope_of(share)/unit;
        }
        for (int e = 0; e < 2; ++e) {
            const dual share = d->z[e == 0 ? DH : DT0];
            z_bar[2*N + PARAMETERS + e] += value_of(share);
            z_bar_slope[2*N + PARAMETERS + e] += scaled_slope_of(share)/unit;
        }
        for (int a = 0; a < 2*N; ++a) {
            d->w[a] = d->z[a];
            if (cotangents != NULL && step % every == 0) {
                const long row = (step/every - first/every)*2*N + a;
                d->w[a] += make_dual(cotangents[row], unit*cotangents_slope[row]);
            }
        }
    }
    for (int a = 0; a < 2*N; ++a) {
        w[a] = value_of(d->w[a]);
        w_slope[a] = scaled_slope_of(d->w[a])/unit;
    }
    return OK;
}

#if GS_CONSTRAINED
/* A row by q, p and constants becomes slopes of a row by q, p, parameters, h and t0. */
static void dual_row(const second_t *d, const dual *by_q, const dual *by_p, const dual *by_c,
    real *row)
{
    const real unit = slope_unit();
    for (int e = 0; e < 2*N + PARAMETERS + 2; ++e)
        row[e] = 0;
    for (int a = 0; a < N; ++a) {
        row[a] = scaled_slope_of(by_q[a])/unit;
        row[N + a] = by_p == NULL ? 0 : scaled_slope_of(by_p[a])/unit;
    }
    for (int i = 0; i < CHAIN; ++i)
        row[2*N + chain_parameter[i]] += scaled_slope_of(d->chain[i]*by_c[chain_constant[i]])/unit;
#if TIMES
    row[2*N + PARAMETERS + 1] = scaled_slope_of(by_c[E - TIMES])/unit;
#endif
}

void NAME(constraint_second)(const parameters_t *parameters, const real q[N], const real p[N],
    const real *dz, real *g_z_slope, real *f_z_slope, void *memory)
{
    second_t *d = ALIGNED(memory);
    enum { ROWS = 2*N + PARAMETERS + 2 };
    dual q0[N], p0[N], G[M][N], g_c[M][E], f_q[M][N], f_p[M][N], f_c[M][E];
    real *z = d->first.z;
    prepare_second(parameters, dz, d);
    to_constants(&d->first, dz, 1, z);
    set_dual_constants(&d->c, &d->first.work.constants, slope_unit(), z + 2*N);
    set_duals(N, q, z, q0);
    set_duals(N, p, z + N, p0);
    const dual_constants *at = TYPED_AT(&d->c,
        make_dual(start_time(parameters), slope_unit()*z[DT0]));
    dual_hidden_derivative(at, q0, p0, f_q, f_p, f_c);
    dual_constraint_jacobian(at, q0, G);
    dual_constraint_by_constants(at, q0, g_c);
    for (int m = 0; m < M; ++m) {
        dual_row(d, G[m], NULL, g_c[m], g_z_slope + m*ROWS);
        dual_row(d, f_q[m], f_p[m], f_c[m], f_z_slope + m*ROWS);
    }
}
#endif

#endif
