/* Transformation of states and multipliers from a co-moving frame to space. */
#ifndef GS_FRAMES_ROTATION_H
#define GS_FRAMES_ROTATION_H

#include "gyrospark/linear_algebra/double_word.h"

/* --------------------------------------------------------------------- from frame to space */

/*
 * The state (q~, p~) in the frame obeys H~ = H - sum omega_i J_i. In space q = e^(omega t A) q~ and
 * p = e^(-omega t A^T) p~, with t since the start of the frame. The angles k dt omega are products
 * in double-word arithmetic, not sums, so that their error does not grow with the number of steps.
 */
typedef struct {
    const parameters_t *parameters;
    double_word rate[ANGLES];
    real axis[AXES]; /* directions of rotations about a general axis */
    int is_moving;
} frame_t;

/* cos and sin of all angles */
typedef struct {
    real cosine[ANGLES], sine[ANGLES];
} angles_t;

/* The frame of these parameters, which must live as long as it. */
static frame_t frame_of(const parameters_t *parameters)
{
    frame_t frame = { .parameters = parameters };
    frame_rates(parameters, frame.rate, frame.axis);
    for (int i = 0; i < ANGLES; ++i)
        frame.is_moving |= !(WIDE_MATH(fabs)(frame.rate[i].high) <= 0);
    return frame;
}

/* cos and sin of the angles (k + share) dt omega */
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

/* Transforms the state (q, p) after k steps to space; q or p may be NULL. */
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
/* Relative time in the step at which multiplier block l acts. */
static real node_of(int l)
{
#if GS_SPARK
    return tableau.c_tilde[l];
#else
    (void)l;
    return (real)0.5;
#endif
}

/*
 * Transforms the multipliers of step k to space, each at the time of its node. Multipliers rotate
 * with the constraints g.
 */
static void rotate_multipliers_of(const frame_t *frame, real dt, long k, real *multipliers)
{
    for (int l = 0; l < MULTIPLIERS/M && frame->is_moving; ++l) {
        angles_t at;
        real x[M];
        angles_after(frame, dt, k - 1, node_of(l), &at);
        rotate_multipliers(frame->parameters, at.cosine, at.sine, frame->axis, multipliers + l*M,
            x);
        for (int mu = 0; mu < M; ++mu)
            multipliers[l*M + mu] = x[mu];
    }
}
#else
/* The constraints g are invariant under the rotation, and so are the multipliers. */
static void rotate_multipliers_of(const frame_t *frame, real dt, long k, real *multipliers)
{
    (void)frame, (void)dt, (void)k, (void)multipliers;
}
#endif

/* Transforms the end of a single step to space. */
static void rotate_step(const parameters_t *parameters, real dt, real q[N], real p[N],
    real *multipliers)
{
    const frame_t frame = frame_of(parameters);
    rotate_state(&frame, dt, 1, q, p);
    rotate_multipliers_of(&frame, dt, 1, multipliers);
}

/*
 * Transforms stored rows to space: row i is the state after before + (i + 1)*every steps. q, p and
 * multipliers may be NULL.
 */
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

/* Transforms the ends and rows of an ensemble to space, as far as each trajectory succeeded. */
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
