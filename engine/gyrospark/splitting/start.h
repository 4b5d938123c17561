/* Start of a composition of flows: durations, rates, momenta in space axes. On numbers. */
#ifndef GS_SPLITTING_START_H
#define GS_SPLITTING_START_H

#include "gyrospark/engine.h"

/* h w for a weight in two words */
static real duration_of(real h, const real w[2])
{
    return (h*w[0]) + (h*w[1]);
}

/*
 * Durations of `count` flows that last h together: the last is h minus the others, in two words. If
 * all were rounded, the clock of the run would drift by their errors at every step.
 */
static void set_durations(real h, int count, const real w[][2], real duration[])
{
    real rest = h;
    real low = (real)0;
    for (int i = 0; i < (count - 1); ++i) {
        duration[i] = duration_of(h, w[i]);
        const real next = rest - duration[i];
        const real share = rest - next;
        low += (rest - (next + share)) + (share - duration[i]);
        rest = next;
    }
    duration[count - 1] = rest + low;
}

#if GS_DRAG
/* Decay of the momentum in a drift, and (1 - exp(-k t))/k, the time that a free motion sees. */
static void set_drag(flows *s, int which, real k)
{
    for (int i = 0; i < (s->stages + 2); ++i) {
        const real x = k*s->drift[i];
        s->decay[which][i] = MATH(exp)(-x);
        s->elapsed[which][i] = (k == (real)0) ? s->drift[i] : (-MATH(expm1)(-x)/k);
    }
}
#endif

#if GS_ROTATING_AXES
/* exp(-t omega/2) of each drift, cosine and vector part, for axes of space that turn at omega. */
static void set_rotating_axes(flows *s, const constants *c)
{
    real omega[SPACES][3];
    space_rates(c, omega);
    for (int k = 0; k < SPACES; ++k) {
        const real *w = omega[k];
        const real size = square_root((w[0]*w[0]) + (w[1]*w[1]) + (w[2]*w[2]) + LIMIT(MIN));
        for (int i = 0; i < s->stages + 2; ++i) {
            real sine;
            sine_cosine((real)0.5*size*s->drift[i], &sine, &s->space_cosine[k][i]);
            for (int e = 0; e < 3; ++e) {
                s->space_vector[k][i][e] = -sine/size*w[e];
            }
        }
    }
}
#endif

/* An axis that the parameters leave undetermined, where nothing rotates about it. */
static void complete_axis(real axis[3], real rate, real offset)
{
    if ((isfinite(axis[0] + axis[1] + axis[2]) == 0) && (rate == (real)0) && (offset == (real)0)) {
        axis[0] = (real)0;
        axis[1] = (real)0;
        axis[2] = (real)1;
    }
}

/*
 * Rates and durations of a run with the time step h. Bodies that are symmetric at these parameters
 * have no further rotations: their drift is exact, and the composition may use it.
 */
static void prepare_flows(flows *s, const constants *c, real h)
{
    flow_rates(c, s->sphere, s->axis_rate, s->axis_offset, s->further_rate, s->further_offset,
        s->drag);
    axis_directions(c, s->axis, s->further_axis);
    for (int k = 0; (AXES > 0) && (k < AXES); ++k) {
        complete_axis(s->axis[k], s->axis_rate[k], s->axis_offset[k]);
    }
    for (int k = 0; (FURTHER > 0) && (k < FURTHER); ++k) {
        complete_axis(s->further_axis[k], s->further_rate[k], s->further_offset[k]);
    }
    s->is_symmetric = 1;
    for (int k = 0; (FURTHER > 0) && (k < FURTHER); ++k) {
        if ((s->further_rate[k] != (real)0) || (s->further_offset[k] != (real)0)) {
            s->is_symmetric = 0;
        }
    }
    const composition_t *used = &compositions[0];
    if ((s->is_symmetric != 0) && (COMPOSITIONS > 1)) {
        used = &compositions[COMPOSITIONS - 1];
    }
    const int stages = used->stages;
    s->stages = stages;
    real between[STAGES + 1];
    set_durations(h, stages, &used->drift[1], between); /* interior drifts, then first and last */
    s->drift[0] = duration_of(h, used->drift[0]);
    for (int i = 1; i < stages; ++i) {
        s->drift[i] = between[i - 1];
    }
    s->drift[stages + 1] = between[stages - 1];
    s->drift[stages] = s->drift[stages + 1] - s->drift[0];
    set_durations(h, stages, used->kick, s->kick);
    for (int i = 0; i < stages; ++i) {
        s->gradient[i] = h*h*used->gradient[i];
        s->kick_time[i] = duration_of(h, used->time[i]);
    }
#if GS_DRAG
    for (int e = 0; e < (BODIES + FREE); ++e) {
        set_drag(s, e, s->drag[e]);
    }
#endif
#if GS_ROTATING_AXES
    set_rotating_axes(s, c);
#endif
}

/* Starts from (q, p), with rotations whose rate stays during the run. */
static void start_flows(flows *s, const real q[N], const real p[N])
{
    set_flow_state(s, q, p);
    for (int b = 0; (BODIES > 0) && (b < BODIES); ++b) {
        const int *at = body_q[b];
        const int k = body_axis[b];
        if ((k >= 0) && (axis_steady[k] != 0) && (s->is_symmetric != 0)) {
            const real r[4] = { q[at[0]], q[at[1]], q[at[2]], q[at[3]] };
            const real rate = (real)0.5*(s->axis_offset[k]
                + (s->axis_rate[k]*axis_momentum(r, &s->now.y[3*b], axis_which[k], s->axis[k])));
            for (int i = 0; i < (s->stages + 2); ++i) {
                sine_cosine(rate*s->drift[i], &s->sine[k][i], &s->cosine[k][i]);
            }
        }
    }
    s->is_underway = 0;
}

#endif
