/* Kernels on NUMBER of the system of splitting.h, and template headers. */
static inline void TYPED(kick_rate)(const TYPED(flow_constants) *c, const NUMBER *q,
    const NUMBER *y, const NUMBER *t, const NUMBER *gradient, NUMBER *rate)
{
    (void)y, (void)t, (void)gradient;
    rate[0] = 2*c->mgl*(q[0]*q[1] - q[2]*q[3]);
    rate[1] = 2*c->mgl*(q[0]*q[2] + q[1]*q[3]);
    rate[2] = c->u - c->k*q[4];
}

static inline void TYPED(free_velocity)(const TYPED(flow_constants) *c, const NUMBER *y,
    NUMBER *velocity, NUMBER *offset)
{
    (void)c;
    velocity[0] = y[3];
    offset[0] = y[3] - y[3];
}

static inline NUMBER TYPED(force_power)(const TYPED(flow_constants) *c, const NUMBER *q,
    const NUMBER *y, const NUMBER *t)
{
    (void)q, (void)t;
    return c->u*y[3];
}

static inline NUMBER TYPED(drag_power)(const TYPED(flow_constants) *c, const NUMBER *q,
    const NUMBER *y)
{
    (void)q;
    return (1/c->I1 - 1/c->I2)*y[1]*y[1];
}

static inline NUMBER TYPED(drift_energy)(const TYPED(flow_constants) *c, const NUMBER *q,
    const NUMBER *y)
{
    (void)q;
    return (y[0]*y[0] + y[1]*y[1] + y[2]*y[2])/(2*c->I1) + y[3]*y[3]/2;
}

static inline NUMBER TYPED(hamiltonian)(const TYPED(flow_constants) *c, const NUMBER *q,
    const NUMBER *p)
{
    return c->mgl*q[0] + p[4]*p[4]/2;
}

static inline void TYPED(constraint)(const TYPED(flow_constants) *c, const NUMBER *q, NUMBER *g)
{
    (void)c;
    g[0] = q[0]*q[0] + q[1]*q[1] + q[2]*q[2] + q[3]*q[3] - 1;
}

static inline void TYPED(hidden_constraint)(const TYPED(flow_constants) *c, const NUMBER *q,
    const NUMBER *p, NUMBER *f)
{
    (void)c;
    f[0] = q[0]*p[0] + q[1]*p[1] + q[2]*p[2] + q[3]*p[3];
}

static inline void TYPED(constraint_jacobian)(const TYPED(flow_constants) *c, const NUMBER *q,
    NUMBER (*G)[N])
{
    (void)c;
    for (int a = 0; a < N; ++a)
        G[0][a] = a < 4 ? 2*q[a] : q[a] - q[a];
}

static inline void TYPED(hidden_matrix)(const TYPED(flow_constants) *c, const NUMBER *q,
    const NUMBER *p, NUMBER (*W)[M])
{
    (void)c, (void)p;
    W[0][0] = 2*(q[0]*q[0] + q[1]*q[1] + q[2]*q[2] + q[3]*q[3]);
}

#if TOY_SPLITTING > 2 && !GS_ON_DUALS
#include "gyrospark/simd/sine_cosine.h"
#endif
#if TOY_SPLITTING > 3
#include "gyrospark/splitting/rotations.h"
#endif
#if TOY_SPLITTING > 4
#include "gyrospark/splitting/flows.h"
#endif
#if TOY_SPLITTING > 5
void TYPED(kick_rate_transposed)(const TYPED(flow_constants) *c, const NUMBER *q, const NUMBER *y,
    const NUMBER *t, const NUMBER *gradient, const NUMBER *rate_bar, NUMBER *q_bar, NUMBER *y_bar,
    NUMBER *t_bar, NUMBER *gradient_bar, NUMBER *c_bar, NUMBER *value);
void TYPED(free_velocity_transposed)(const TYPED(flow_constants) *c, const NUMBER *y,
    const NUMBER *velocity_bar, const NUMBER *offset_bar, NUMBER *y_bar, NUMBER *c_bar);
void TYPED(flow_rates_transposed)(const TYPED(flow_constants) *c, const NUMBER *sphere_bar,
    const NUMBER *axis_rate_bar, const NUMBER *axis_offset_bar, const NUMBER *further_rate_bar,
    const NUMBER *further_offset_bar, const NUMBER *drag_bar, NUMBER *c_bar);
void TYPED(axis_directions_transposed)(const TYPED(flow_constants) *c, const NUMBER *axis_bar,
    const NUMBER *further_axis_bar, NUMBER *c_bar);
void TYPED(space_rates_transposed)(const TYPED(flow_constants) *c, const NUMBER *omega_bar,
    NUMBER *c_bar);
#include "gyrospark/derivatives/step_maps.h"
#endif
#if TOY_SPLITTING > 6
#include "gyrospark/derivatives/splitting.h"
#endif
