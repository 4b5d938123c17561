/* Trajectories that continue in a co-moving frame. */
#ifndef GS_FRAMES_TRAJECTORY_H
#define GS_FRAMES_TRAJECTORY_H

#include "gyrospark/frames/rotation.h"

/* What a trajectory that is held has of its frame. */
static void begin_frame(work_t *w, const parameters_t *parameters)
{
    w->simulation.frame_parameters = *parameters;
    w->simulation.frame_start = w->simulation.report.steps;
    for (int a = 0; a < N; ++a) {
        w->frame_q[a] = w->simulation.q[a];
        w->frame_p[a] = w->simulation.p[a];
    }
}

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

/* At another rate it begins anew where the trajectory is; what was past is of the old one. */
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

/* A state as the caller has it, in the frame: to the bit where it left it. */
static void into_frame(const work_t *w, real q[N], real p[N])
{
    const frame_t frame = frame_of(&w->simulation.frame_parameters);
    int same_q = 1, same_p = 1;
    for (int a = 0; a < N; ++a) {
        same_q &= q[a] == w->simulation.q[a];
        same_p &= p[a] == w->simulation.p[a];
    }
    rotate_state(&frame, w->simulation.dt, w->simulation.frame_start - w->simulation.report.steps, q, p);
    for (int a = 0; a < N; ++a) {
        q[a] = same_q ? w->frame_q[a] : q[a];
        p[a] = same_p ? w->frame_p[a] : p[a];
    }
}

/* The state that the caller sees. */
static void out_of_frame(work_t *w, real q[N], real p[N])
{
    const frame_t frame = frame_of(&w->simulation.frame_parameters);
    for (int a = 0; a < N; ++a) {
        w->frame_q[a] = q[a];
        w->frame_p[a] = p[a];
    }
    rotate_state(&frame, w->simulation.dt, w->simulation.report.steps - w->simulation.frame_start, q, p);
}

/* A run goes on in the frame where it was; at other rates in one that begins where it is. */
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

/* It stays there; what the caller sees is turned back. */
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
    rotate_rows(&frame, dt, before - frame_start, every, (report->steps - before)/every, q_out, p_out,
        multipliers);
}

#endif
