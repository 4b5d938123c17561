/* Transformation of states back from a co-moving frame. */
#ifndef GS_FRAMES_ROTATION_H
#define GS_FRAMES_ROTATION_H

#include "gyrospark/linear_algebra/double_word.h"

/* ------------------------------------------------------------------ back from a co-moving frame */

/*
 * What is integrated is q~, p~ of H~ = H - sum omega_i J_i; q = e^(omega t A) q~ and
 * p = e^(-omega t A^T) p~, t since the start of the run. Angles are k dt omega, counted, not
 * summed up, in twice the digits: a run of any length loses none by turning.
 */
typedef struct {
    const parameters_t *parameters;
    double_word rate[ANGLES];
    real axis[AXES]; /* of rotations about any axis of space */
    int is_moving;
} frame_t;

/* cos and sin of every angle. */
typedef struct {
    real cosine[ANGLES], sine[ANGLES];
} angles_t;

static frame_t frame_of(const parameters_t *parameters)
{
    frame_t frame = { .parameters = parameters };
    frame_rates(parameters, frame.rate, frame.axis);
    for (int i = 0; i < ANGLES; ++i)
        frame.is_moving |= !(WIDE_MATH(fabs)(frame.rate[i].high) <= 0);
    return frame;
}

/* The angles after k + share steps. */
static void angles_after(const frame_t *frame, real dt, long k, real share, angles_t *at)
{
    const double_word t = plus(product_of((wide_real)k, dt), product_of(share, dt));
    for (int i = 0; i < ANGLES; ++i) {
        wide_real cosine, sine;
        cos_sin(times(t, frame->rate[i]), &cosine, &sine);
        at->cosine[i] = (real)cosine;
        at->sine[i] = (real)sine;
    }
}

/* The state (q, p) after k steps; either may be NULL. */
static void rotate_state(const frame_t *frame, real dt, long k, real *q, real *p)
{
    angles_t at;
    real x[N];
    if (k == 0 || !frame->is_moving)
        return;
    angles_after(frame, dt, k, 0, &at);
    if (q != NULL) {
        rotate_coordinates(frame->parameters, at.cosine, at.sine, frame->axis, q, x);
        for (int a = 0; a < N; ++a)
            q[a] = x[a];
    }
    if (p != NULL) {
        rotate_momenta(frame->parameters, at.cosine, at.sine, frame->axis, p, x);
        for (int a = 0; a < N; ++a)
            p[a] = x[a];
    }
}

#if GS_ROTATING_MULTIPLIERS
/* Where in its step the constraint of a multiplier is. */
static real node_of(int l)
{
#if GS_SPARK
    return tableau.c_tilde[l];
#else
    (void)l;
    return (real)0.5;
#endif
}

/* The multipliers of step k, each at the time of its node: where g turns, so do they. */
static void rotate_multipliers_of(const frame_t *frame, real dt, long k, real *multipliers)
{
    for (int l = 0; l < MULTIPLIERS/M && frame->is_moving; ++l) {
        angles_t at;
        real x[M];
        angles_after(frame, dt, k - 1, node_of(l), &at);
        rotate_multipliers(frame->parameters, at.cosine, at.sine, frame->axis, multipliers + l*M, x);
        for (int mu = 0; mu < M; ++mu)
            multipliers[l*M + mu] = x[mu];
    }
}
#else
/* g does not turn, and multipliers are the same. */
static void rotate_multipliers_of(const frame_t *frame, real dt, long k, real *multipliers)
{
    (void)frame, (void)dt, (void)k, (void)multipliers;
}
#endif

/* The end of one step. */
static void rotate_step(const parameters_t *parameters, real dt, real q[N], real p[N],
    real *multipliers)
{
    const frame_t frame = frame_of(parameters);
    rotate_state(&frame, dt, 1, q, p);
    rotate_multipliers_of(&frame, dt, 1, multipliers);
}

/* Rows of states, every so many steps after the first `before`; NULL where there are none. */
static void rotate_rows(const frame_t *frame, real dt, long before, long every, long rows, real *q,
    real *p, real *multipliers)
{
    for (long row = 0; row < rows; ++row) {
        const long k = before + (row + 1)*every;
        rotate_state(frame, dt, k, q == NULL ? NULL : q + row*N, p == NULL ? NULL : p + row*N);
        if (multipliers != NULL)
            rotate_multipliers_of(frame, dt, k, multipliers + row*MULTIPLIERS);
    }
}

/* Whole runs, up to where they came. */
static void rotate_runs(long count, const parameters_t *parameters, const real *dt, long rows,
    long every, real *q, real *p, real *q_out, real *p_out, const report_t *reports)
{
    for (long i = 0; i < count; ++i) {
        const frame_t frame = frame_of(parameters + i);
        const long done = reports[i].steps;
        rotate_state(&frame, dt[i], done, q + i*N, p + i*N);
        rotate_rows(&frame, dt[i], 0, every, done/every, q_out == NULL ? NULL : q_out + i*rows*N,
            p_out == NULL ? NULL : p_out + i*rows*N, NULL);
    }
}

#endif
