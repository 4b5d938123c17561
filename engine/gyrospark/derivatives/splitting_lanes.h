/* Derivatives of as many steps of a composition of flows as there are lanes. */
#ifndef GS_DERIVATIVES_SPLITTING_LANES_H
#define GS_DERIVATIVES_SPLITTING_LANES_H

#include "gyrospark/derivatives/step_maps.h"

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
    l->s.is_symmetric = 0;
    l->s.t = t;
    lanes_start_of_step(&l->s, q, p);
    lanes_take_step(l, p);
    return OK;
}

#endif
