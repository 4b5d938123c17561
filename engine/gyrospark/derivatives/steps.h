/* Public functions: tangents and adjoints of a step and of runs whose unknowns were kept. */
#ifndef GS_DERIVATIVES_STEPS_H
#define GS_DERIVATIVES_STEPS_H

#if GS_SPLITTING && GS_PROFILE_CONTROL
#include "gyrospark/profiles/control.h"
#elif GS_SPLITTING
#include "gyrospark/run/integrate.h"
#elif GS_PROFILE_RUN
#include "gyrospark/profiles/run.h"
#elif GS_PROFILE_CONTROL
#include "gyrospark/derivatives/control.h"
#else
#include "gyrospark/run/advance.h"
#endif

#if GS_ELEMENTS
#define IF_ELEMENTS(...) __VA_ARGS__
#else
#define IF_ELEMENTS(...)
#endif

/* The unknowns of a step: a composition of flows has none, and C no empty arrays. */
#if GS_SPLITTING
#define UNKNOWNS(x) *x
#else
#define UNKNOWNS(x) x[U]
#endif

/* Results of a step: q1, p1, multipliers */
enum { RESULTS = 2*N + MULTIPLIERS };

/* Memory of derivatives, ALIGNED in the caller's memory. */
typedef struct {
    work_t work;
#if GS_DERIVATIVES_IN_LANES
    lanes_constants lane_constants;
    lanes_linearisation_t l;
    /* Derivatives of the results of LANES steps; the same, step by step. */
#if !GS_SPLITTING
    lanes x[RESULTS][U], force[RESULTS][P][N];
#endif
    lanes matrix[RESULTS][Z];
    real rows[LANES][RESULTS*Z];
#else
    constants c;
    linearisation_t l;
#endif
    real chain[CHAIN + 1]; /* nonzero derivatives of the constants by the parameters */
    real multipliers[ROOM], z[Z], w[2*N], q[2*N], p[2*N]; /* or derivatives of them */
#if GS_ELEMENTS
    rates_matrices rates;
#if GS_CONSTRAINED
    hidden_t hidden;
#endif
#endif
} derivatives_t;

static derivatives_t *derivatives_of(void *memory)
{
    return ALIGNED(memory);
}

size_t NAME(derivative_size)(void)
{
    return sizeof(derivatives_t) + 64;
}

#if GS_SPLITTING
/* Nothing is solved. */
void NAME(keep)(const work_t *work, const options_t *options, real UNKNOWNS(x))
{
    (void)work, (void)options, (void)x;
}
#elif GS_PROFILE_RUN
/* The last unknowns are the first of the history, which a step by Newton's method clears. */
void NAME(keep)(const work_t *work, const options_t *options, real x[U])
{
    (void)options;
    if (work->state.history_length > 0)
        get_unknowns(&work->state, work->state.history[0], x);
    for (int e = 0; e < U && work->state.history_length == 0; ++e)
        x[e] = work->x[e];
}
#elif GS_PROFILE_CONTROL
/* The last unknowns are the first of the history. */
void NAME(keep)(const work_t *work, const options_t *options, real x[U])
{
    (void)options;
    get_unknowns(work, work->history[0], x);
}
#elif GS_FIXED_POINT
void NAME(keep)(const work_t *work, const options_t *options, real x[U])
{
    work_t *w = (work_t *)work;
    if (options->solver != NEWTON)
        SINGLE(get_unknowns)(&fixed_point_of(w)->solver, x);
    for (int e = 0; e < U && options->solver == NEWTON; ++e)
        x[e] = w->x[e];
}
#else
void NAME(keep)(const work_t *work, const options_t *options, real x[U])
{
    (void)options;
    for (int e = 0; e < U; ++e)
        x[e] = work->x[e];
}
#endif

#if GS_FRAME
void NAME(frame_state)(const work_t *work, real q[N], real p[N])
{
    for (int a = 0; a < N; ++a) {
        q[a] = work->frame_q[a];
        p[a] = work->frame_p[a];
    }
}
#endif

#if !GS_PROFILE_RUN && !GS_PROFILE_CONTROL
/* A function of the primal module, by its address: NAME(integrate). */
typedef int (*integrate_function)(const parameters_t *, const options_t *, IF_INPUTS(
    const real *, long,) real, long, long, real *, real *, real *, real *, real *, int *, IF_FORCES(
    real *,) report_t *, work_t *);

int NAME(integrate_and_keep)(size_t integrate, const parameters_t *parameters,
    const options_t *options, IF_INPUTS(const real *inputs, long hold,) real dt, long steps,
    real *q, real *p, real *x, report_t *report, work_t *work)
{
    const integrate_function run = (integrate_function)integrate;
    for (long j = 0; j < steps; ++j, q += N, p += N, x += U) {
        for (int a = 0; a < N; ++a) {
            q[N + a] = q[a];
            p[N + a] = p[a];
        }
        const int status = run(parameters, options, IF_INPUTS(inputs, hold,) dt, 1, 1, q + N, p + N,
            NULL, NULL, NULL, NULL, IF_FORCES(NULL,) report, work);
        if (status != OK)
            return status;
        IF_FRAME(NAME(frame_state)(work, q + N, p + N);)
        NAME(keep)(work, options, x);
    }
    return OK;
}
#endif

/* Rows q, p, parameters, h, t0 of the caller become rows q, p, constants, t0, h. */
static void to_constants(const derivatives_t *d, const real *dz, int stride, real z[Z])
{
    for (int e = 0; e < Z; ++e)
        z[e] = e < 2*N ? dz[e*stride] : 0;
    for (int i = 0; i < CHAIN; ++i)
        z[2*N + chain_constant[i]] += d->chain[i]*dz[(2*N + chain_parameter[i])*stride];
    z[DH] = dz[(2*N + PARAMETERS)*stride];
    z[DT0] = dz[(2*N + PARAMETERS + 1)*stride];
}

/* Adds a cotangent of the constants to the rows of the parameters, by the chain rule. */
static void add_chain(const derivatives_t *d, const real c[E], real *z_bar)
{
    for (int i = 0; i < CHAIN; ++i)
        z_bar[2*N + chain_parameter[i]] += d->chain[i]*c[chain_constant[i]];
}

/* Adds a cotangent of rows q, p, constants, t0, h to one of rows q, p, parameters, h, t0. */
static void add_to_parameters(const derivatives_t *d, const real z[Z], real *z_bar)
{
    add_chain(d, z + 2*N, z_bar);
    z_bar[2*N + PARAMETERS] += z[DH];
    z_bar[2*N + PARAMETERS + 1] += z[DT0];
}

/* Evaluates the constants of a run and their derivatives by the parameters. */
static void prepare_derivatives(const parameters_t *parameters, derivatives_t *d)
{
    prepare(parameters, &d->work.constants);
    constants_by_parameters(parameters, d->chain);
}

#if GS_CONSTRAINED
/* Rows of g or f by q, p and constants become rows by q, p, parameters, h and t0. */
static void rows_by_parameters(const derivatives_t *d, const real *by_q, const real *by_p,
    const real *by_c, real *row)
{
    for (int e = 0; e < 2*N + PARAMETERS + 2; ++e)
        row[e] = 0;
    for (int a = 0; a < N; ++a) {
        row[a] = by_q[a];
        row[N + a] = by_p == NULL ? 0 : by_p[a];
    }
    add_chain(d, by_c, row);
#if TIMES
    row[2*N + PARAMETERS + 1] = by_c[E - TIMES];
#endif
}

void NAME(constraint_derivatives)(const parameters_t *parameters, const real q[N], const real p[N],
    real *g_z, real *f_z, void *memory)
{
    derivatives_t *d = derivatives_of(memory);
    enum { ROWS = 2*N + PARAMETERS + 2 };
    prepare_derivatives(parameters, d);
    const constants *at = AT(&d->work.constants, start_time(parameters));
#if GS_ELEMENTS
    (void)linearise_hidden(at, q, p, &d->hidden);
    for (int m = 0; m < M; ++m) {
        real unit[M] = { 0 }, by_q[N] = { 0 }, by_p[N] = { 0 }, by_c[E] = { 0 };
        unit[m] = 1;
        constraint_value_transposed(&d->hidden.value, unit, by_q, by_c);
        rows_by_parameters(d, by_q, NULL, by_c, g_z + m*ROWS);
        for (int a = 0; a < N; ++a)
            by_q[a] = 0;
        for (int e = 0; e < E; ++e)
            by_c[e] = 0;
        add_hidden_transposed(&d->hidden, unit, by_q, by_p, by_c);
        rows_by_parameters(d, by_q, by_p, by_c, f_z + m*ROWS);
    }
#else
    real G[M][N], g_c[M][E], f_q[M][N], f_p[M][N], f_c[M][E];
    hidden_derivative(at, q, p, f_q, f_p, f_c);
    constraint_jacobian(at, q, G);
    constraint_by_constants(at, q, g_c);
    for (int m = 0; m < M; ++m) {
        rows_by_parameters(d, G[m], NULL, g_c[m], g_z + m*ROWS);
        rows_by_parameters(d, f_q[m], f_p[m], f_c[m], f_z + m*ROWS);
    }
#endif
}
#endif

#if GS_DERIVATIVES_IN_LANES
/* Steps of a block: they are linearised together. */
enum { BLOCK_STEPS = LANES };

/*
 * Linearises `count` steps, at most LANES, one in each lane; the others repeat the first. Row a of
 * each matrix is the adjoint of the unit vector a, so that a step alone has the same derivatives as
 * among others, and the sequence of steps takes no more than products with small matrices. Of the
 * results the first 2 N are differentiated, or all.
 */
static int linearise_steps(derivatives_t *d, IF_INPUTS(const inputs_t *inputs,) long first,
    real start, real dt, int count, const real *q, const real *p, const real *x, int results)
{
    lanes q0[N], p0[N], q1[N], p1[N], unknowns[U + 1], t = splat(0);
    d->lane_constants._used = LANES;
    for (int i = 0; i < LANES; ++i) {
        const int j = i < count ? i : 0;
        IF_INPUTS(set_step_inputs(&d->work.constants, inputs, 0, first + j);)
        set_constants(&d->lane_constants, i, &d->work.constants);
        lane_set(&t, i, start + (real)(first + j)*dt);
        for (int a = 0; a < N; ++a) {
            lane_set(&q0[a], i, q[j*N + a]);
            lane_set(&p0[a], i, p[j*N + a]);
            lane_set(&q1[a], i, q[(j + 1)*N + a]);
            lane_set(&p1[a], i, p[(j + 1)*N + a]);
        }
        for (int e = 0; e < U; ++e)
            lane_set(&unknowns[e], i, x[j*U + e]);
    }
#if GS_SPLITTING
    const int status = lanes_linearise(&d->lane_constants, t, splat(dt), q0, p0, &d->l);
    for (int a = 0; a < results; ++a) {
        lanes unit[RESULTS];
        for (int b = 0; b < RESULTS; ++b)
            unit[b] = splat(a == b);
        lanes_step_adjoint(&d->l, unit, NULL, d->matrix[a]);
    }
#else
    const int status = lanes_linearise(&d->lane_constants, t, splat(dt), q0, p0, unknowns, q1, p1,
        &d->l);
    if (status != OK)
        return status;
    for (int a = 0; a < results; ++a) {
        lanes unit[RESULTS];
        for (int b = 0; b < RESULTS; ++b)
            unit[b] = splat(a == b);
        lanes_adjoint_of_end(&d->l, unit, a < 2*N ? NULL : unit + 2*N, d->x[a], d->force[a],
            d->matrix[a]);
    }
    lanes_solve_transposed_all(U, d->l.J, d->l.pivots, results, &d->x[0][0]);
    for (int a = 0; a < results; ++a)
        lanes_adjoint_of_stages(&d->l, d->x[a], d->force[a], d->matrix[a]);
#endif
    for (int i = 0; i < count; ++i)
        for (int e = 0; e < results*Z; ++e)
            d->rows[i][e] = lane_get(&d->matrix[0][0] + e, i);
    return status;
}

/* d->w and, if wanted, d->multipliers <- the derivatives of the results of step i along d->z */
static int step_tangent_of(derivatives_t *d, int i, int with_multipliers)
{
    for (int a = 0; a < (with_multipliers ? RESULTS : 2*N); ++a) {
        real sum = 0;
        for (int e = 0; e < Z; ++e)
            sum += d->rows[i][a*Z + e]*d->z[e];
        if (a < 2*N)
            d->w[a] = sum;
        else
            d->multipliers[a - 2*N] = sum;
    }
    return OK;
}

/* z <- the cotangent of the start of step i, of those of its end, w, and of its multipliers */
static int step_adjoint_of(derivatives_t *d, int i, const real w[2*N], const real *multipliers,
    real z[Z])
{
    for (int e = 0; e < Z; ++e)
        z[e] = 0;
    for (int a = 0; a < (multipliers == NULL ? 2*N : RESULTS); ++a) {
        const real weight = a < 2*N ? w[a] : multipliers[a - 2*N];
        for (int e = 0; e < Z; ++e)
            z[e] += d->rows[i][a*Z + e]*weight;
    }
    return OK;
}
#else
enum { BLOCK_STEPS = 1 };

/* Linearises the step from row 0 of q and p to row 1, step `first` of a run. */
static int linearise_steps(derivatives_t *d, IF_INPUTS(const inputs_t *inputs,) long first,
    real start, real dt, int count, const real *q, const real *p, const real *x, int results)
{
    (void)count, (void)results;
    IF_INPUTS(set_step_inputs(&d->work.constants, inputs, 0, first);)
    d->c = d->work.constants;
    IF_ELEMENTS(d->l.w = &d->work;)
    return linearise(&d->c, start + (real)first*dt, dt, q, p, x, q + N, p + N, &d->l);
}

static int step_tangent_of(derivatives_t *d, int i, int with_multipliers)
{
    real dx[U + 1];
    (void)i;
    return step_tangent(&d->l, d->z, dx, d->w, with_multipliers ? d->multipliers : NULL);
}

static int step_adjoint_of(derivatives_t *d, int i, const real w[2*N], const real *multipliers,
    real z[Z])
{
    (void)i;
    return step_adjoint(&d->l, w, multipliers, z);
}
#endif

/* Linearises a single step, whose end is computed. */
static int linearise_single(const parameters_t *parameters, real dt, const real q[N],
    const real p[N], const real UNKNOWNS(x), int results, derivatives_t *d)
{
    const real start = start_time(parameters);
    prepare_derivatives(parameters, d);
#if GS_SPLITTING
    const int status = OK; /* the end is not needed */
#else
    d->work.t = start;
    IF_TIME(d->work.step = dt;)
    const int status = finish(&d->work, dt, q, p, x, d->q + N, d->p + N, d->multipliers);
#endif
    for (int a = 0; a < N; ++a) {
        d->q[a] = q[a];
        d->p[a] = p[a];
    }
    IF_INPUTS(const inputs_t none = { 0 };)
    return status == OK ? linearise_steps(d, IF_INPUTS(&none,) 0, start, dt, 1, d->q, d->p, x,
        results) : status;
}

int NAME(tangent)(const parameters_t *parameters, real dt, const real q[N], const real p[N],
    const real UNKNOWNS(x), int count, const real *dz, real *dz1, real *multipliers, void *memory)
{
    derivatives_t *d = derivatives_of(memory);
    const int results = multipliers == NULL ? 2*N : RESULTS;
    int status = linearise_single(parameters, dt, q, p, x, results, d);
    for (int k = 0; k < count && status == OK; ++k) {
        to_constants(d, dz + k, count, d->z);
        status = step_tangent_of(d, 0, multipliers != NULL);
        for (int a = 0; a < 2*N; ++a)
            dz1[a*count + k] = d->w[a];
        for (int e = 0; e < MULTIPLIERS && multipliers != NULL; ++e)
            multipliers[e*count + k] = d->multipliers[e];
    }
    return status;
}

int NAME(adjoint)(const parameters_t *parameters, real dt, const real q[N], const real p[N],
    const real UNKNOWNS(x), const real w[2*N], const real *multipliers, real *z_bar, void *memory)
{
    derivatives_t *d = derivatives_of(memory);
    const int results = multipliers == NULL ? 2*N : RESULTS;
    int status = linearise_single(parameters, dt, q, p, x, results, d);
    if (status == OK)
        status = step_adjoint_of(d, 0, w, multipliers, d->z);
    if (status != OK)
        return status;
    for (int a = 0; a < 2*N; ++a)
        z_bar[a] += d->z[a];
    add_to_parameters(d, d->z, z_bar);
    return OK;
}

/*
 * Rows 0..steps of q and p, and rows 0..steps - 1 of x; `first` steps were done before. multipliers,
 * if not NULL, has MULTIPLIERS rows for each step.
 */
int NAME(integrate_tangent)(const parameters_t *parameters, IF_INPUTS(
    const real *inputs, long hold,) real dt, long first, long steps, const real *q,
    const real *p, const real *x, int count, const real *dz, long every, real *rows,
    real *multipliers, real *tangents, void *memory)
{
    derivatives_t *d = derivatives_of(memory);
    IF_INPUTS(const inputs_t own = { inputs, hold, 0 };)
    prepare_derivatives(parameters, d);
    const real start = start_time(parameters);
    for (long j = 0; j < steps; j += BLOCK_STEPS) {
        const int together = steps - j < BLOCK_STEPS ? (int)(steps - j) : BLOCK_STEPS;
        int status = linearise_steps(d, IF_INPUTS(
            &own,) first + j, start, dt, together, q + j*N, p + j*N, x + j*U,
            multipliers == NULL ? 2*N : RESULTS);
        if (status != OK)
            return status;
        for (int i = 0; i < together; ++i) {
            const long step = first + j + i;
            for (int k = 0; k < count; ++k) {
                to_constants(d, dz + k, count, d->z);
                d->z[DT0] += (real)step*d->z[DH];
                for (int a = 0; a < 2*N; ++a)
                    d->z[a] = tangents[a*count + k];
                status = step_tangent_of(d, i, multipliers != NULL);
                if (status != OK)
                    return status;
                for (int a = 0; a < 2*N; ++a)
                    tangents[a*count + k] = d->w[a];
                for (int e = 0; e < MULTIPLIERS && multipliers != NULL; ++e)
                    multipliers[((j + i)*MULTIPLIERS + e)*count + k] = d->multipliers[e];
            }
            if ((step + 1) % every != 0 || rows == NULL)
                continue;
            for (int e = 0; e < 2*N*count; ++e)
                *rows++ = tangents[e];
        }
    }
    return OK;
}

/*
 * Backwards through the steps first..first + steps - 1 of a run. On entry w is the cotangent of the
 * last state, on return that of the first; cotangents, if not NULL, has a row of 2 N for each
 * earlier state j that is a multiple of `every`, at row j/every - first/every. multipliers and
 * inputs_bar, if not NULL, have a row for each step: cotangents of its multipliers, of its inputs.
 */
int NAME(integrate_adjoint)(const parameters_t *parameters, IF_INPUTS(
    const real *inputs, long hold, real *inputs_bar,) real dt, long first, long steps,
    const real *q, const real *p, const real *x, const real *cotangents, long every,
    const real *multipliers, real *w, real *z_bar, void *memory)
{
    derivatives_t *d = derivatives_of(memory);
    IF_INPUTS(const inputs_t own = { inputs, hold, 0 };)
    prepare_derivatives(parameters, d);
    const real start = start_time(parameters);
    for (long end = steps; end > 0;) { /* blocks are those of integrate_tangent */
        const long j = (end - 1)/BLOCK_STEPS*BLOCK_STEPS;
        int status = linearise_steps(d, IF_INPUTS(
            &own,) first + j, start, dt, (int)(end - j), q + j*N, p + j*N, x + j*U,
            multipliers == NULL ? 2*N : RESULTS);
        if (status != OK)
            return status;
        for (; end > j; --end) {
            const long step = first + end - 1;
            status = step_adjoint_of(d, (int)(end - 1 - j), w, multipliers == NULL ? NULL
                : multipliers + (end - 1)*MULTIPLIERS, d->z);
            if (status != OK)
                return status;
            d->z[DH] += (real)step*d->z[DT0];
#if GS_INPUTS
            for (int i = 0; i < INPUTS && inputs_bar != NULL; ++i) {
                const int place = input_constant[i];
                inputs_bar[(end - 1)*INPUTS + i] = place < 0 ? 0 : d->z[2*N + place];
                if (place >= 0 && inputs != NULL)
                    d->z[2*N + place] = 0;
            }
#endif
            add_to_parameters(d, d->z, z_bar);
            for (int a = 0; a < 2*N; ++a)
                w[a] = d->z[a];
            if (cotangents != NULL && step % every == 0)
                for (int a = 0; a < 2*N; ++a)
                    w[a] += cotangents[(step/every - first/every)*2*N + a];
        }
    }
    return OK;
}

#endif
