/* A step of a composition of flows, linearised: as many as lanes, or one; its tangents. */
#ifndef GS_DERIVATIVES_SPLITTING_STEPS_H
#define GS_DERIVATIVES_SPLITTING_STEPS_H

#include "gyrospark/derivatives/step_maps.h"
#include "gyrospark/linear_algebra/norms.h"

#if GS_DERIVATIVES_IN_LANES
/* All lanes have the same parameters and time steps. */
static int lanes_linearise(const lanes_constants *c, lanes t, lanes h, const lanes q[N],
    const lanes p[N], lanes_linearisation_t *l)
{
    constants first;
    flows own = { 0 };
    const real *numbers = (const real *)(const void *)&own;
    lanes *in_lanes = (lanes *)(void *)&l->s;
    get_constants(c, 0, &first);
    own.h = lane_get(&h, 0);
    prepare_flows(&own, &first, own.h);
    for (int e = 0; e < FLOW_NUMBERS; ++e)
        in_lanes[e] = splat(numbers[e]);
    l->c = c;
    l->s.stages = own.stages;
    l->is_symmetric = own.is_symmetric;
    l->s.is_symmetric = 0;
    l->s.t = t;
    lanes_set_flow_state(&l->s, q, p);
    lanes_take_step(l, p);
    return OK;
}
#else
/* A step that was done: nothing was solved, so that neither unknowns nor the end are needed. */
static int linearise(const constants *c, real t, real h, const real *q, const real *p,
    const real *x, const real *q1, const real *p1, linearisation_t *l)
{
    (void)x, (void)q1, (void)p1;
    l->c = c;
    l->s.h = h;
    l->s.t = t;
    prepare_flows(&l->s, c, h);
    l->is_symmetric = l->s.is_symmetric;
    l->s.is_symmetric = 0;
    set_flow_state(&l->s, q, p);
    take_step(l, p);
    return isfinite(norm(N, l->s.now.q) + norm(Y, l->s.now.y)) ? OK : NOT_FINITE;
}

/* value (1 + power dh/h), a multiple of h^power */
static inline dual scaled_by_step(real value, real power, dual h)
{
    return make_dual(value, power*value*scaled_slope_of(h)/value_of(h));
}

/* s <- the flows `of` a run with the slopes of the constants c and of the time step h */
static void prepare_dual_flows(dual_flows *s, const flows *of, const dual_constants *c, dual h)
{
    dual_flow_rates(c, s->sphere, s->axis_rate, s->axis_offset, s->further_rate, s->further_offset,
        s->drag);
    dual_axis_directions(c, s->axis, s->further_axis);
    for (int k = 0; AXES > 0 && k < AXES; ++k) /* those that complete_axis has set */
        for (int e = 0; e < 3; ++e)
            if (!isfinite(value_of(s->axis[k][e])))
                s->axis[k][e] = dual_broadcast(of->axis[k][e]);
    for (int k = 0; FURTHER > 0 && k < FURTHER; ++k)
        for (int e = 0; e < 3; ++e)
            if (!isfinite(value_of(s->further_axis[k][e])))
                s->further_axis[k][e] = dual_broadcast(of->further_axis[k][e]);
    s->h = h;
    s->stages = of->stages;
    s->is_symmetric = 0;
    for (int i = 0; i < STAGES + 2; ++i)
        s->drift[i] = scaled_by_step(of->drift[i], 1, h);
    for (int i = 0; i < STAGES; ++i) {
        s->kick[i] = scaled_by_step(of->kick[i], 1, h);
        s->gradient[i] = scaled_by_step(of->gradient[i], 2, h);
        s->kick_time[i] = scaled_by_step(of->kick_time[i], 1, h);
    }
#if GS_DRAG
    for (int e = 0; e < BODIES + FREE; ++e)
        for (int i = 0; i <= s->stages; ++i) {
            const real k = of->drag[e], a = of->drift[i], decay = of->decay[e][i];
            const real elapsed = of->elapsed[e][i], dk = scaled_slope_of(s->drag[e]);
            const real da = scaled_slope_of(s->drift[i]);
            s->decay[e][i] = make_dual(decay, -decay*(k*da + a*dk));
            s->elapsed[e][i] = make_dual(elapsed,
                decay*da + elapsed_slope(k, a, elapsed, decay)*dk);
        }
#endif
#if GS_ROTATING_AXES
    dual omega[SPACES][3];
    dual_space_rates(c, omega);
    for (int k = 0; k < SPACES; ++k) {
        const dual size = dual_size_of(omega[k]);
        for (int i = 0; i <= s->stages; ++i) {
            dual sine;
            dual_sine_cosine((real)0.5*size*s->drift[i], &sine, &s->space_cosine[k][i]);
            for (int e = 0; e < 3; ++e)
                s->space_vector[k][i][e] = -sine*(1/size)*omega[k][e];
        }
    }
#endif
}

/* The step that `l` is of, along z: derivatives of its end. */
static int step_tangent(const linearisation_t *l, const real z[Z], real *dx, real dz1[2*N],
    real *multipliers)
{
    const real unit = slope_unit();
    dual_constants c;
    dual_flows s;
    dual q[N], p[N];
    (void)dx, (void)multipliers; /* there are none */
    set_dual_constants(&c, l->c, unit, z + 2*N);
    prepare_dual_flows(&s, &l->s, &c, make_dual(l->s.h, unit*z[DH]));
    s.t = make_dual(l->s.t, unit*z[DT0]);
    for (int a = 0; a < N; ++a) {
        q[a] = make_dual(l->start[0].q[a], unit*z[a]);
        p[a] = make_dual(l->p[a], unit*z[N + a]);
    }
    dual_set_flow_state(&s, q, p);
    for (int m = 0; m < maps_of(s.stages); ++m)
        dual_take_map(&c, &s, map_of(l->is_symmetric, m));
    dual_end_of_maps(&s, q, p);
    for (int a = 0; a < N; ++a) {
        dz1[a] = scaled_slope_of(q[a])/unit;
        dz1[N + a] = scaled_slope_of(p[a])/unit;
    }
    return OK;
}

#if GS_SECOND_DERIVATIVES
/* A step on dual numbers, with `of` that of its values. */
static int dual_linearise(const dual_constants *c, dual t, dual h, const dual q[N],
    const dual p[N], const linearisation_t *of, dual_linearisation_t *l)
{
    prepare_dual_flows(&l->s, &of->s, c, h);
    l->is_symmetric = of->is_symmetric;
    l->c = c;
    l->s.t = t;
    dual_set_flow_state(&l->s, q, p);
    dual_take_step(l, p);
    return OK;
}
#endif
#endif

#endif
