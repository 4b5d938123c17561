/* Trajectories and runs that continue in a co-moving frame from call to call. */
#ifndef GS_FRAMES_TRAJECTORY_H
#define GS_FRAMES_TRAJECTORY_H

#include "gyrospark/frames/rotation.h"

/* Starts a frame at the current state of the trajectory in `w`. */
static void begin_frame(work_t *w, const parameters_t *parameters)
{
    w->simulation.frame_parameters = *parameters;
    w->simulation.frame_start = w->simulation.report.steps;
    for (int a = 0; a < N; ++a) {
        w->frame_q[a] = w->simulation.q[a];
        w->frame_p[a] = w->simulation.p[a];
    }
}

/* Whether two sets of parameters have the same frame, bit by bit. */
static int same_frame(const parameters_t *one, const parameters_t *other)
{
    const frame_t old = frame_of(one), new = frame_of(other);
    int same = 1;
    for (int i = 0; i < ANGLES; ++i)
        same &= old.rate[i].high == new.rate[i].high && old.rate[i].low == new.rate[i].low;
    for (int i = 0; i < AXES; ++i)
        same &= old.axis[i] == new.axis[i];
    return same;
}

/*
 * Updates the parameters of the frame. Another rate starts a new frame at the current state; the
 * history of the predictor refers to the old frame and is discarded.
 */
static void change_frame(work_t *w, const parameters_t *parameters)
{
    const int same = same_frame(&w->simulation.frame_parameters, parameters);
    w->simulation.frame_parameters = *parameters;
    if (same)
        return;
    begin_frame(w, parameters);
    if (w->simulation.options.solver != NEWTON)
        reset_iteration(w);
}

/*
 * Transforms the caller's state to the frame. If the caller did not change q (or p), its stored
 * value in the frame is restored, so that the transformation adds no round-off.
 */
static void into_frame(const work_t *w, real q[N], real p[N])
{
    const frame_t frame = frame_of(&w->simulation.frame_parameters);
    int same_q = 1, same_p = 1;
    for (int a = 0; a < N; ++a) {
        same_q &= q[a] == w->simulation.q[a];
        same_p &= p[a] == w->simulation.p[a];
    }
    rotate_state(&frame, w->simulation.dt,
        w->simulation.frame_start - w->simulation.report.steps, q, p);
    for (int a = 0; a < N; ++a) {
        q[a] = same_q ? w->frame_q[a] : q[a];
        p[a] = same_p ? w->frame_p[a] : p[a];
    }
}

/* Stores the state in the frame and transforms (q, p) to space for the caller. */
static void out_of_frame(work_t *w, real q[N], real p[N])
{
    const frame_t frame = frame_of(&w->simulation.frame_parameters);
    for (int a = 0; a < N; ++a) {
        w->frame_q[a] = q[a];
        w->frame_p[a] = p[a];
    }
    rotate_state(&frame, w->simulation.dt,
        w->simulation.report.steps - w->simulation.frame_start, q, p);
}

/* Continues a run in its frame; other rates start a new frame at (q, p). */
static void enter_frame(const parameters_t *parameters, const options_t *options, real dt,
    const report_t *report, work_t *w, real q[N], real p[N])
{
    if (report->steps == 0 || same_frame(&w->simulation.frame_parameters, parameters)) {
        for (int a = 0; a < N && report->steps > 0; ++a) {
            q[a] = w->frame_q[a];
            p[a] = w->frame_p[a];
        }
        w->simulation.frame_start = report->steps == 0 ? 0 : w->simulation.frame_start;
        w->simulation.frame_parameters = *parameters;
        return;
    }
    w->simulation.frame_parameters = *parameters;
    w->simulation.frame_start = report->steps;
    w->simulation.dt = dt;
    w->simulation.report = *report;
    prepare(parameters, &w->constants);
    if (options->solver == NEWTON)
        return;
    set_state(w, q, p);
    reset_iteration(w);
}

/* Stores the end of a run in the frame, and transforms the end and the rows to space. */
static void leave_frame(real dt, long before, long every, const report_t *report, work_t *w,
    real q[N], real p[N], real *q_out, real *p_out, real *multipliers)
{
    const frame_t frame = frame_of(&w->simulation.frame_parameters);
    const long frame_start = w->simulation.frame_start;
    for (int a = 0; a < N; ++a) {
        w->frame_q[a] = q[a];
        w->frame_p[a] = p[a];
    }
    rotate_state(&frame, dt, report->steps - frame_start, q, p);
    rotate_rows(&frame, dt, before - frame_start, every, (report->steps - before)/every, q_out,
        p_out, multipliers);
}

#endif
