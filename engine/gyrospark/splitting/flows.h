/*
 * One step of a composition of exact flows, for numbers and for lanes:
 *
 *     T(a_0 h) K_1 T(a_1 h) K_2 ... K_s T(a_s h),   K_i = K(b_i h), or K(b_i h/2) R(b_i h) K(b_i h/2)
 *
 * T: free rotations and translations, K: kicks by the potential with its force gradient and by
 * forces, R: rotations of asymmetric bodies that do not commute with T (Hairer-Lubich-Wanner, II.5,
 * VII.5). The last T of a step and the first of the next are one flow: TYPED(flows) is behind the
 * last kick, and the state at the end of the step is found on a copy.
 */

/* Starts from (q, p): momenta in space axes, nothing is lost in sums. */
INLINE void TYPED(set_flow_state)(TYPED(flows) *s, const NUMBER q[N], const NUMBER p[N])
{
    for (int a = 0; a < N; ++a) {
        s->now.q[a] = q[a];
        s->now.q_low[a] = TYPED(broadcast)(0);
    }
    for (int b = 0; (BODIES > 0) && (b < BODIES); ++b) {
        const int *at = body_q[b];
        const NUMBER r[4] = { q[at[0]], q[at[1]], q[at[2]], q[at[3]] };
        const NUMBER momentum[4] = { p[at[0]], p[at[1]], p[at[2]], p[at[3]] };
        TYPED(angular_momentum_of)(r, momentum, &s->now.y[3*b]);
    }
    for (int e = 0; e < FREE; ++e) {
        s->now.y[(3*BODIES) + e] = p[free_q[e]];
    }
    for (int e = 0; e < Y; ++e) {
        s->now.y_low[e] = TYPED(broadcast)(0);
    }
}

/* p <- the momenta of coordinates, from those in space axes */
INLINE void TYPED(momenta_at)(const NUMBER q[N], const NUMBER y[Y], NUMBER p[N])
{
    for (int b = 0; (BODIES > 0) && (b < BODIES); ++b) {
        const int *at = body_q[b];
        const NUMBER r[4] = { q[at[0]], q[at[1]], q[at[2]], q[at[3]] };
        NUMBER momentum[4];
        TYPED(momentum_of)(r, &y[3*b], momentum);
        TYPED(set_quaternion)(momentum, at, p);
    }
    for (int e = 0; e < FREE; ++e) {
        p[free_q[e]] = y[(3*BODIES) + e];
    }
}

/* Free motion during duration i: bodies rotate, points move. */
INLINE void TYPED(drift)(const TYPED(flow_constants) *c, const TYPED(flows) *s, int i,
    NUMBER q[N], NUMBER q_low[N], NUMBER y[Y])
{
    const NUMBER duration = s->drift[i];
    for (int b = 0; (BODIES > 0) && (b < BODIES); ++b) {
        const int *at = body_q[b];
        const int k = body_axis[b];
        NUMBER r[4] = { q[at[0]], q[at[1]], q[at[2]], q[at[3]] };
        NUMBER *l = &y[3*b];
#if GS_DRAG
        const NUMBER elapsed = s->elapsed[b][i];
#else
        const NUMBER elapsed = duration;
#endif
        if (k >= 0) {
            NUMBER cosine = s->cosine[k][i];
            NUMBER sine = s->sine[k][i];
            if ((axis_steady[k] == 0) || (s->is_symmetric == 0)) {
                TYPED(sine_cosine)((real)0.5*((s->axis_rate[k]*elapsed
                    *TYPED(axis_momentum)(r, l, axis_which[k], s->axis[k]))
                    + (s->axis_offset[k]*duration)), &sine, &cosine);
            }
            TYPED(rotate_about_axis)(r, axis_which[k], s->axis[k], cosine, sine);
        }
        TYPED(rotate_freely)(r, l, (real)0.5*s->sphere[b]*elapsed);
        TYPED(set_quaternion)(r, at, q);
#if GS_DRAG
        for (int e = 0; e < 3; ++e) {
            l[e] *= s->decay[b][i];
        }
#endif
    }
    if (FREE > 0) {
        NUMBER velocity[FREE + 1];
        NUMBER offset[FREE + 1];
        TYPED(free_velocity)(c, y, velocity, offset);
        for (int e = 0; e < FREE; ++e) {
#if GS_DRAG
            TYPED(accumulate)(&q[free_q[e]], &q_low[free_q[e]],
                (s->elapsed[BODIES + e][i]*velocity[e]) + (duration*offset[e]));
            y[(3*BODIES) + e] *= s->decay[BODIES + e][i];
#else
            TYPED(accumulate)(&q[free_q[e]], &q_low[free_q[e]],
                duration*(velocity[e] + offset[e]));
#endif
        }
    }
}

#if GS_ROTATING_AXES
/* v <- R(w) v for the unit quaternion w = (c, u), by an increment: its length has no bias. */
INLINE void TYPED(turn_vector)(NUMBER c, const NUMBER *u, NUMBER *const *v, NUMBER *const *v_low)
{
    const NUMBER x = *v[0];
    const NUMBER y = *v[1];
    const NUMBER z = *v[2];
    const NUMBER a[3] = { u[1]*z - u[2]*y, u[2]*x - u[0]*z, u[0]*y - u[1]*x };
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1)%3;
        const int k = (i + 2)%3;
        TYPED(accumulate)(v[i], v_low[i], 2*(c*a[i] + (u[j]*a[k] - u[k]*a[j])));
    }
}

/* The flow of -omega.J during drift i, which commutes with the free motion: all vectors turn. */
INLINE void TYPED(rotate_axes)(const TYPED(flows) *s, int i, NUMBER q[N],
    NUMBER q_low[N], NUMBER y[Y], NUMBER y_low[Y])
{
    for (int b = 0; (BODIES > 0) && (b < BODIES); ++b) {
        const int k = body_space[b];
        const int *at = body_q[b];
        if (k < 0) {
            continue;
        }
        const NUMBER c = s->space_cosine[k][i];
        const NUMBER *u = s->space_vector[k][i];
        NUMBER *const l[3] = { y + 3*b, y + 3*b + 1, y + 3*b + 2 };
        NUMBER *const l_low[3] = { y_low + 3*b, y_low + 3*b + 1, y_low + 3*b + 2 };
        const NUMBER r[4] = { q[at[0]], q[at[1]], q[at[2]], q[at[3]] };
        const NUMBER rotation[4] = { c, u[0], u[1], u[2] };
        NUMBER turned[4];
        TYPED(quaternion_product)(rotation, r, turned);
        TYPED(set_quaternion)(turned, at, q);
        TYPED(turn_vector)(c, u, l, l_low);
    }
    for (int e = 0; e < SPACE_POINTS; ++e) {
        const int *in_q = space_point_q[e];
        const int *in_y = space_point_y[e];
        const int k = space_of_point[e];
        NUMBER none[2] = { TYPED(broadcast)(0), TYPED(broadcast)(0) }; /* z of a point in a plane */
        const int flat = in_q[2] < 0;
        NUMBER *const r[3] = { q + in_q[0], q + in_q[1], flat ? none : q + in_q[2] };
        NUMBER *const r_low[3] = { q_low + in_q[0], q_low + in_q[1], flat ? none + 1 : q_low + in_q[2] };
        NUMBER *const p[3] = { y + in_y[0], y + in_y[1], flat ? none : y + in_y[2] };
        NUMBER *const p_low[3] = { y_low + in_y[0], y_low + in_y[1], flat ? none + 1 : y_low + in_y[2] };
        TYPED(turn_vector)(s->space_cosine[k][i], s->space_vector[k][i], r, r_low);
        TYPED(turn_vector)(s->space_cosine[k][i], s->space_vector[k][i], p, p_low);
    }
}
#endif

/* Kick i for the duration: momenta change, positions stay. */
INLINE void TYPED(kick)(const TYPED(flow_constants) *c, TYPED(flows) *s, int i, NUMBER duration)
{
    const NUMBER t[1] = { s->t + s->kick_time[i] };
    const NUMBER gradient[1] = { s->gradient[i] };
    NUMBER rate[KICKED + 1];
#if GS_MOMENTUM_FORCES
    NUMBER middle[Y]; /* explicit midpoint rule: order 2 */
    TYPED(kick_rate)(c, s->now.q, s->now.y, t, gradient, rate);
    for (int e = 0; e < Y; ++e) {
        middle[e] = s->now.y[e];
    }
    for (int k = 0; k < KICKED; ++k) {
        middle[kicked[k]] += (real)0.5*duration*rate[k];
    }
    TYPED(kick_rate)(c, s->now.q, middle, t, gradient, rate);
#else
    TYPED(kick_rate)(c, s->now.q, s->now.y, t, gradient, rate);
#endif
#if GS_FORCES && !GS_ON_DUALS
    NUMBER mean[Y];
    for (int e = 0; e < Y; ++e) {
        mean[e] = s->now.y[e];
    }
    for (int k = 0; k < KICKED; ++k) {
        mean[kicked[k]] += (real)0.5*duration*rate[k];
    }
    TYPED(accumulate)(&s->now.work, &s->now.work_low, duration*TYPED(force_power)(c, s->now.q, mean, t));
#endif
    for (int k = 0; k < KICKED; ++k) {
        TYPED(accumulate)(&s->now.y[kicked[k]], &s->now.y_low[kicked[k]], duration*rate[k]);
    }
}

/* The rotation k of an asymmetric body for a duration. */
INLINE void TYPED(rotate_further)(TYPED(flows) *s, int k, NUMBER duration)
{
    const int *at = body_q[further_body[k]];
    NUMBER r[4] = { s->now.q[at[0]], s->now.q[at[1]], s->now.q[at[2]], s->now.q[at[3]] };
    NUMBER sine;
    NUMBER cosine;
    TYPED(sine_cosine)((real)0.5*duration*((s->further_rate[k]
        *TYPED(axis_momentum)(r, &s->now.y[3*further_body[k]], further_which[k],
        s->further_axis[k])) + s->further_offset[k]), &sine, &cosine);
    TYPED(rotate_about_axis)(r, further_which[k], s->further_axis[k], cosine, sine);
    TYPED(set_quaternion)(r, at, s->now.q);
}

/* What is between two drifts: a kick, and rotations that do not commute with the drift. */
INLINE void TYPED(kick_and_rotate)(const TYPED(flow_constants) *c, TYPED(flows) *s, int i)
{
    const NUMBER duration = s->kick[i];
    if ((FURTHER == 0) || (s->is_symmetric != 0)) {
        TYPED(kick)(c, s, i, duration);
    } else {
        TYPED(kick)(c, s, i, (real)0.5*duration);
        for (int k = 0; k < (FURTHER - 1); ++k) {
            TYPED(rotate_further)(s, k, (real)0.5*duration);
        }
        if (FURTHER > 0) {
            TYPED(rotate_further)(s, FURTHER - 1, duration);
        }
        for (int k = FURTHER - 2; k >= 0; --k) {
            TYPED(rotate_further)(s, k, (real)0.5*duration);
        }
        TYPED(kick)(c, s, i, (real)0.5*duration);
    }
}

#if !GS_ON_DUALS /* their steps are those of derivatives/splitting.h */
/* Free motion i, and rotating axes; with drag and forces, returns the work of the drag. */
INLINE NUMBER TYPED(drift_and_turn)(const TYPED(flow_constants) *c, const TYPED(flows) *s, int i,
    NUMBER q[N], NUMBER q_low[N], NUMBER y[Y], NUMBER y_low[Y])
{
#if GS_DRAG && GS_FORCES
    /* The gain of what the motion conserves, and on the rest of H by the trapezoidal rule. */
    NUMBER work = (real)0.5*s->drift[i]*TYPED(drag_power)(c, q, y) - TYPED(drift_energy)(c, q, y);
#endif
    (void)y_low; /* without rotating axes */
    TYPED(drift)(c, s, i, q, q_low, y);
#if GS_ROTATING_AXES
    TYPED(rotate_axes)(s, i, q, q_low, y, y_low);
#endif
#if GS_DRAG && GS_FORCES
    work += (real)0.5*s->drift[i]*TYPED(drag_power)(c, q, y);
    return work + TYPED(drift_energy)(c, q, y);
#else
    return TYPED(broadcast)(0);
#endif
}

/* The drift of a step that counts its work. */
INLINE void TYPED(drift_on)(const TYPED(flow_constants) *c, TYPED(flows) *s, int i)
{
    const NUMBER work = TYPED(drift_and_turn)(c, s, i, s->now.q, s->now.q_low, s->now.y,
        s->now.y_low);
#if GS_DRAG && GS_FORCES
    TYPED(accumulate)(&s->now.work, &s->now.work_low, work);
#else
    (void)work;
#endif
}

/* What follows the drift of a stage; the last stage ends the step up to its last drift. */
INLINE void TYPED(end_stage)(const TYPED(flow_constants) *c, TYPED(flows) *s, int i)
{
    TYPED(kick_and_rotate)(c, s, i);
    RELOAD_STATE;
    if (i >= (s->stages - 1)) {
        for (int b = 0; (BODIES > 0) && (b < BODIES); ++b) {
            const int *at = body_q[b];
            NUMBER r[4] = { s->now.q[at[0]], s->now.q[at[1]], s->now.q[at[2]], s->now.q[at[3]] };
            TYPED(normalise)(r);
            TYPED(set_quaternion)(r, at, s->now.q);
        }
        s->is_underway = 1;
    }
}

/* A drift and a kick of a step. */
INLINE void TYPED(take_stage)(const TYPED(flow_constants) *c, TYPED(flows) *s, int i)
{
    const int first = (s->is_underway != 0) ? (s->stages + 1) : 0;
    TYPED(drift_on)(c, s, (i > 0) ? i : first);
    TYPED(end_stage)(c, s, i);
}

/* The state at the end of the step: the last drift on a copy. `work` is that of this drift. */
INLINE void TYPED(end_of_step)(const TYPED(flow_constants) *c, const TYPED(flows) *s,
    NUMBER q[N], NUMBER p[N], NUMBER *work)
{
    NUMBER y[Y];
    NUMBER q_low[N];
    NUMBER y_low[Y];
    for (int a = 0; a < N; ++a) {
        q[a] = s->now.q[a];
        q_low[a] = s->now.q_low[a];
    }
    for (int e = 0; e < Y; ++e) {
        y[e] = s->now.y[e];
        y_low[e] = s->now.y_low[e];
    }
    *work = TYPED(broadcast)(0);
    if (s->is_underway != 0) {
        *work = TYPED(drift_and_turn)(c, s, s->stages, q, q_low, y, y_low);
    }
    TYPED(momenta_at)(q, y, p);
}
#endif
