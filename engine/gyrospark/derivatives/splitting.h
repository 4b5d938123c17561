/*
 * Derivatives of one step of a composition of flows, for numbers, lanes and dual numbers. The maps
 * of the step are explicit: their starts are found forwards, their transposes are applied
 * backwards. All rotations of asymmetric bodies take part, at the rate 0 where a body is symmetric.
 * |q| = 1 and q.p = 0 are not scaled or projected: the step keeps them.
 */

/* A state: coordinates, and momenta in space axes. */
typedef struct {
    NUMBER q[N], y[Y];
} TYPED(flow_point);

/*
 * A step: constants of the run, flows, cotangents of their members, the start of each map, p, and
 * whether the run is symmetric; the flows say no, so that no rate of an axis is taken as steady.
 */
typedef struct {
    const TYPED(flow_constants) *c;
    TYPED(flows) s, bar;
    TYPED(flow_point) start[STEP_MAPS + 1];
    NUMBER p[N];
    int is_symmetric;
} TYPED(linearisation_t);

/* r <- the quaternion at these places of q */
INLINE void TYPED(get_quaternion)(const NUMBER *q, const int at[4], NUMBER r[4])
{
    for (int e = 0; e < 4; ++e)
        r[e] = q[at[e]];
}

/* A map of a step, forwards. */
INLINE void TYPED(take_map)(const TYPED(flow_constants) *c, TYPED(flows) *s, step_map map)
{
    if (map.kind == DRIFT)
        TYPED(drift)(c, s, map.stage, s->now.q, s->now.q_low, s->now.y);
#if GS_ROTATING_AXES
    else if (map.kind == AXES_TURN)
        TYPED(rotate_axes)(s, map.stage, s->now.q, s->now.q_low, s->now.y, s->now.y_low);
#endif
    else if (map.kind == KICK)
        TYPED(kick)(c, s, map.stage, map.share*s->kick[map.stage]);
    else if (FURTHER > 0)
        TYPED(rotate_further)(s, map.rotation, map.share*s->kick[map.stage]);
}

/* The state at the end. */
INLINE void TYPED(end_of_maps)(const TYPED(flows) *s, NUMBER q[N], NUMBER p[N])
{
    for (int a = 0; a < N; ++a)
        q[a] = s->now.q[a];
    TYPED(momenta_at)(q, s->now.y, p);
}

#if !GS_ON_DUALS || GS_SECOND_DERIVATIVES
/* All maps of a step whose start is set. */
static void TYPED(take_step)(TYPED(linearisation_t) *l, const NUMBER p[N])
{
    const int maps = maps_of(l->s.stages);
    for (int m = 0; m <= maps; ++m) {
        for (int a = 0; a < N; ++a)
            l->start[m].q[a] = l->s.now.q[a];
        for (int e = 0; e < Y; ++e)
            l->start[m].y[e] = l->s.now.y[e];
        if (m < maps)
            TYPED(take_map)(l->c, &l->s, map_of(l->is_symmetric, m));
    }
    for (int a = 0; a < N; ++a)
        l->p[a] = p[a];
}

/* The conjugate of a quaternion */
INLINE void TYPED(conjugate_of)(const NUMBER a[4], NUMBER conjugate[4])
{
    conjugate[0] = a[0];
    for (int e = 1; e < 4; ++e)
        conjugate[e] = -a[e];
}

/* From the cotangent of e.m, m = R(q)^T l, to those of q, l and e. */
INLINE void TYPED(axis_momentum_transposed)(const NUMBER q[4], const NUMBER l[3], int which,
    const NUMBER e[3], NUMBER m_bar, NUMBER q_bar[4], NUMBER l_bar[3], NUMBER e_bar[3])
{
    for (int i = which < 3 ? which : 0; i < (which < 3 ? which + 1 : 3); ++i) {
        const int j = (i + 1)%3, k = (i + 2)%3;
        const NUMBER a = q[0], x = q[1 + i], y = q[1 + j], z = q[1 + k];
        const NUMBER w = which < 3 ? m_bar : e[i]*m_bar;
        q_bar[0] += 2*w*(l[i]*a + l[j]*z - l[k]*y);
        q_bar[1 + i] += 2*w*(l[i]*x + l[j]*y + l[k]*z);
        q_bar[1 + j] += 2*w*(l[j]*x - l[i]*y - l[k]*a);
        q_bar[1 + k] += 2*w*(l[j]*a - l[i]*z + l[k]*x);
        l_bar[i] += w*(a*a + x*x - y*y - z*z);
        l_bar[j] += 2*w*(x*y + a*z);
        l_bar[k] += 2*w*(x*z - a*y);
        if (which == 3)
            e_bar[i] += m_bar*TYPED(body_momentum)(q, l, i);
    }
}

/* The rotation about a body axis at the rate d e.m + c: members of the flows, or cotangents. */
typedef struct {
    NUMBER *d, *c, *e, *elapsed, *duration;
} TYPED(axis_turn);

/* q_bar and l_bar, behind the rotation of q, become those before it; bar gains. */
INLINE void TYPED(axis_turn_transposed)(int which, const TYPED(axis_turn) *at,
    const NUMBER q[4], const NUMBER l[3], NUMBER q_bar[4], NUMBER l_bar[3],
    const TYPED(axis_turn) *bar)
{
    const NUMBER m = TYPED(axis_momentum)(q, l, which, at->e);
    NUMBER s, c, back[4], conjugate[4], u[4], old[4];
    TYPED(sine_cosine)((real)0.5*(*at->d**at->elapsed*m + *at->c**at->duration), &s, &c);
    back[0] = c;
    for (int i = 0; i < 3; ++i)
        back[1 + i] = -s*at->e[i];
    TYPED(conjugate_of)(q, conjugate);
    TYPED(quaternion_product)(conjugate, q_bar, u);
    for (int e = 0; e < 4; ++e)
        old[e] = q_bar[e];
    TYPED(quaternion_product)(old, back, q_bar);
    NUMBER half = -s*u[0];
    for (int i = 0; i < 3; ++i) {
        half += c*at->e[i]*u[1 + i];
        bar->e[i] += s*u[1 + i];
    }
    half *= (real)0.5;
    *bar->d += half**at->elapsed*m;
    *bar->elapsed += half**at->d*m;
    *bar->c += half**at->duration;
    *bar->duration += half**at->c;
    TYPED(axis_momentum_transposed)(q, l, which, at->e, half**at->d**at->elapsed, q_bar, l_bar,
        bar->e);
}

/*
 * (turn cos x - sin(x)/size)/size^2 for x = turn size: sin(x)/size has this derivative by l, times l.
 * On dual numbers it is a power series where x is small.
 */
INLINE NUMBER TYPED(turn_slope)(NUMBER turn, NUMBER size, NUMBER cosine, NUMBER k)
{
#if GS_ON_DUALS
    const NUMBER x = turn*size;
    if (value_of(x) < (real)0.5 && value_of(x) > (real)-0.5) {
        NUMBER sum = 0, power = turn*turn*turn;
        real share = -(real)1/3; /* (-1)^j 2 j/(2 j + 1)!, from j = 1 on */
        for (int j = 1; j < 16; ++j) {
            sum += share*power;
            power *= x*x;
            share /= -(real)(2*j*(2*j + 3));
        }
        return sum;
    }
#endif
    return (turn*cosine - k)/(size*size);
}

/*
 * From the cotangent u of exp(turn l), a quaternion, to that of turn, which is returned, and l. `size`
 * is |l|, s and c are sine and cosine of turn |l|. Where l = 0 the dual s/size would underflow.
 */
INLINE NUMBER TYPED(exponential_transposed)(const NUMBER l[3], NUMBER turn, NUMBER size, NUMBER s,
    NUMBER c, const NUMBER u[4], NUMBER l_bar[3])
{
    const NUMBER k = s*(1/size), along = u[1]*l[0] + u[2]*l[1] + u[3]*l[2];
    const NUMBER across = TYPED(turn_slope)(turn, size, c, k)*along - turn*k*u[0];
    for (int i = 0; i < 3; ++i)
        l_bar[i] += k*u[1 + i] + across*l[i];
    return c*along - s*size*u[0];
}

/* The same of q <- exp(turn l) q. */
INLINE NUMBER TYPED(rotate_freely_transposed)(const NUMBER q[4], const NUMBER l[3], NUMBER turn,
    NUMBER q_bar[4], NUMBER l_bar[3])
{
    const NUMBER size = TYPED(size_of)(l);
    NUMBER s, c, back[4], conjugate[4], u[4], old[4];
    TYPED(sine_cosine)(turn*size, &s, &c);
    back[0] = c;
    for (int i = 0; i < 3; ++i)
        back[1 + i] = -s*(1/size)*l[i];
    TYPED(conjugate_of)(q, conjugate);
    TYPED(quaternion_product)(q_bar, conjugate, u);
    for (int e = 0; e < 4; ++e)
        old[e] = q_bar[e];
    TYPED(quaternion_product)(back, old, q_bar);
    return TYPED(exponential_transposed)(l, turn, size, s, c, u, l_bar);
}

#if GS_ROTATING_AXES
/* From the cotangent of R(w) v, w = (c, u), to those of v and w. */
INLINE void TYPED(turn_vector_transposed)(NUMBER c, const NUMBER u[3], const NUMBER v[3],
    NUMBER *const v_bar[3], NUMBER *c_bar, NUMBER u_bar[3])
{
    const NUMBER w[3] = { *v_bar[0], *v_bar[1], *v_bar[2] };
    NUMBER a[3], b[3];
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1)%3, k = (i + 2)%3;
        a[i] = u[j]*v[k] - u[k]*v[j];
        b[i] = w[j]*u[k] - w[k]*u[j];
    }
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1)%3, k = (i + 2)%3;
        *c_bar += 2*w[i]*a[i];
        u_bar[i] += 2*(c*(v[j]*w[k] - v[k]*w[j]) + (a[j]*w[k] - a[k]*w[j])
            + (v[j]*b[k] - v[k]*b[j]));
        *v_bar[i] += 2*(c*b[i] + (b[j]*u[k] - b[k]*u[j]));
    }
}

/* Of the flow of -omega.J during drift i. */
INLINE void TYPED(rotate_axes_transposed)(TYPED(linearisation_t) *l, int i,
    const TYPED(flow_point) *at)
{
    const TYPED(flows) *s = &l->s;
    TYPED(flows) *bar = &l->bar;
    for (int b = 0; BODIES > 0 && b < BODIES; ++b) {
        const int k = body_space[b];
        if (k < 0)
            continue;
        const NUMBER c = s->space_cosine[k][i], *u = s->space_vector[k][i];
        const NUMBER back[4] = { c, -u[0], -u[1], -u[2] };
        NUMBER *const l_bar[3] = { bar->now.y + 3*b, bar->now.y + 3*b + 1, bar->now.y + 3*b + 2 };
        NUMBER q[4], conjugate[4], q_bar[4], w_bar[4];
        TYPED(get_quaternion)(at->q, body_q[b], q);
        TYPED(get_quaternion)(bar->now.q, body_q[b], q_bar);
        TYPED(conjugate_of)(q, conjugate);
        TYPED(quaternion_product)(q_bar, conjugate, w_bar);
        TYPED(quaternion_product)(back, q_bar, q);
        TYPED(set_quaternion)(q, body_q[b], bar->now.q);
        bar->space_cosine[k][i] += w_bar[0];
        for (int e = 0; e < 3; ++e)
            bar->space_vector[k][i][e] += w_bar[1 + e];
        TYPED(turn_vector_transposed)(c, u, at->y + 3*b, l_bar, &bar->space_cosine[k][i],
            bar->space_vector[k][i]);
    }
    for (int e = 0; e < SPACE_POINTS; ++e) {
        const int *in_q = space_point_q[e], *in_y = space_point_y[e], k = space_of_point[e];
        const int flat = in_q[2] < 0;
        NUMBER none = TYPED(broadcast)(0); /* z of a point in a plane */
        const NUMBER r[3] = { at->q[in_q[0]], at->q[in_q[1]], flat ? none : at->q[in_q[2]] };
        const NUMBER p[3] = { at->y[in_y[0]], at->y[in_y[1]], flat ? none : at->y[in_y[2]] };
        NUMBER *const r_bar[3] = { bar->now.q + in_q[0], bar->now.q + in_q[1],
            flat ? &none : bar->now.q + in_q[2] };
        TYPED(turn_vector_transposed)(s->space_cosine[k][i], s->space_vector[k][i], r, r_bar,
            &bar->space_cosine[k][i], bar->space_vector[k][i]);
        none = TYPED(broadcast)(0);
        NUMBER *const p_bar[3] = { bar->now.y + in_y[0], bar->now.y + in_y[1],
            flat ? &none : bar->now.y + in_y[2] };
        TYPED(turn_vector_transposed)(s->space_cosine[k][i], s->space_vector[k][i], p, p_bar,
            &bar->space_cosine[k][i], bar->space_vector[k][i]);
    }
}

/* Cotangents of the rotations exp(-t omega/2) become those of omega, then of constants, and t. */
static void TYPED(space_transposed)(TYPED(linearisation_t) *l, NUMBER c_bar[E])
{
    NUMBER omega[SPACES][3], omega_bar[SPACES][3], own[E];
    TYPED(space_rates)(l->c, omega);
    for (int k = 0; k < SPACES; ++k) {
        for (int e = 0; e < 3; ++e)
            omega_bar[k][e] = TYPED(broadcast)(0);
        const NUMBER size = TYPED(size_of)(omega[k]);
        for (int i = 0; i <= l->s.stages; ++i) {
            const NUMBER *v = l->bar.space_vector[k][i], turn = (real)-0.5*l->s.drift[i];
            const NUMBER u[4] = { l->bar.space_cosine[k][i], v[0], v[1], v[2] };
            NUMBER sine, cosine;
            TYPED(sine_cosine)(turn*size, &sine, &cosine);
            l->bar.drift[i] -= (real)0.5*TYPED(exponential_transposed)(omega[k], turn, size, sine,
                cosine, u, omega_bar[k]);
        }
    }
    TYPED(space_rates_transposed)(l->c, (const NUMBER *)omega_bar, own);
    for (int e = 0; e < E; ++e)
        c_bar[e] += own[e];
}
#endif

/* Of the free motion i, from (q, y); the state's cotangent is bar->now. */
INLINE void TYPED(drift_transposed)(TYPED(linearisation_t) *l, int i, const TYPED(flow_point) *at,
    NUMBER *c_bar)
{
    TYPED(flows) *s = &l->s, *bar = &l->bar;
    for (int b = 0; BODIES > 0 && b < BODIES; ++b) {
        const int k = body_axis[b];
        const NUMBER *momentum = at->y + 3*b;
        NUMBER *l_bar = bar->now.y + 3*b, q[4], first[4], q_bar[4];
#if GS_DRAG
        NUMBER *elapsed = &s->elapsed[b][i], *elapsed_bar = &bar->elapsed[b][i];
        for (int e = 0; e < 3; ++e) {
            bar->decay[b][i] += l_bar[e]*momentum[e];
            l_bar[e] *= s->decay[b][i];
        }
#else
        NUMBER *elapsed = &s->drift[i], *elapsed_bar = &bar->drift[i];
#endif
        TYPED(get_quaternion)(at->q, body_q[b], q);
        TYPED(get_quaternion)(at->q, body_q[b], first);
        TYPED(get_quaternion)(bar->now.q, body_q[b], q_bar);
        if (k >= 0) {
            NUMBER sine, cosine;
            TYPED(sine_cosine)((real)0.5*(s->axis_rate[k]**elapsed
                *TYPED(axis_momentum)(q, momentum, axis_which[k], s->axis[k])
                + s->axis_offset[k]*s->drift[i]), &sine, &cosine);
            TYPED(rotate_about_axis)(q, axis_which[k], s->axis[k], cosine, sine);
        }
        const NUMBER turn_bar = TYPED(rotate_freely_transposed)(q, momentum,
            (real)0.5*s->sphere[b]**elapsed, q_bar, l_bar);
        bar->sphere[b] += (real)0.5**elapsed*turn_bar;
        *elapsed_bar += (real)0.5*s->sphere[b]*turn_bar;
        if (k >= 0) {
            const TYPED(axis_turn) turn = { &s->axis_rate[k], &s->axis_offset[k], s->axis[k],
                elapsed, &s->drift[i] };
            const TYPED(axis_turn) own = { &bar->axis_rate[k], &bar->axis_offset[k], bar->axis[k],
                elapsed_bar, &bar->drift[i] };
            TYPED(axis_turn_transposed)(axis_which[k], &turn, first, momentum, q_bar, l_bar, &own);
        }
        TYPED(set_quaternion)(q_bar, body_q[b], bar->now.q);
    }
    if (FREE > 0) {
        NUMBER velocity[FREE + 1], offset[FREE + 1], y_bar[Y], own[E];
        NUMBER velocity_bar[FREE + 1], offset_bar[FREE + 1];
        TYPED(free_velocity)(l->c, at->y, velocity, offset);
        for (int e = 0; e < FREE; ++e) {
            const NUMBER x_bar = bar->now.q[free_q[e]];
#if GS_DRAG
            NUMBER *elapsed = &s->elapsed[BODIES + e][i];
            NUMBER *elapsed_bar = &bar->elapsed[BODIES + e][i];
            bar->decay[BODIES + e][i] += bar->now.y[3*BODIES + e]*at->y[3*BODIES + e];
            bar->now.y[3*BODIES + e] *= s->decay[BODIES + e][i];
#else
            NUMBER *elapsed = &s->drift[i], *elapsed_bar = &bar->drift[i];
#endif
            velocity_bar[e] = *elapsed*x_bar;
            offset_bar[e] = s->drift[i]*x_bar;
            *elapsed_bar += velocity[e]*x_bar;
            bar->drift[i] += offset[e]*x_bar;
        }
        TYPED(free_velocity_transposed)(l->c, at->y, velocity_bar, offset_bar, y_bar, own);
        for (int e = 0; e < Y; ++e)
            bar->now.y[e] += y_bar[e];
        for (int e = 0; e < E; ++e)
            c_bar[e] += own[e];
    }
}

/*
 * Of the rates of kick i at (q, y), which are times `duration`, from those of what they add to
 * momenta; y_bar gains that of y. Returns the cotangent of the duration.
 */
INLINE NUMBER TYPED(kick_rate_adjoint)(TYPED(linearisation_t) *l, int i, NUMBER duration,
    const NUMBER q[N], const NUMBER y[Y], const NUMBER weight[KICKED + 1], NUMBER y_bar[Y],
    NUMBER *c_bar)
{
    TYPED(flows) *s = &l->s, *bar = &l->bar;
    const NUMBER t[1] = { s->t + s->kick_time[i] }, gradient[1] = { s->gradient[i] };
    NUMBER q_own[N], y_own[Y], t_own[1], gradient_own[1], c_own[E], value[1];
    TYPED(kick_rate_transposed)(l->c, q, y, t, gradient, weight, q_own, y_own, t_own, gradient_own,
        c_own, value);
    for (int a = 0; a < N; ++a)
        bar->now.q[a] += duration*q_own[a];
    for (int e = 0; e < Y; ++e)
        y_bar[e] += duration*y_own[e];
    bar->t += duration*t_own[0];
    bar->kick_time[i] += duration*t_own[0];
    bar->gradient[i] += duration*gradient_own[0];
    for (int e = 0; e < E; ++e)
        c_bar[e] += duration*c_own[e];
    return value[0];
}

/* Of a share of kick i, from the point at its start */
INLINE void TYPED(kick_transposed)(TYPED(linearisation_t) *l, int i, real share,
    const TYPED(flow_point) *at, NUMBER *c_bar)
{
    const NUMBER duration = share*l->s.kick[i];
    NUMBER weight[KICKED + 1], y_bar[Y];
    weight[KICKED] = TYPED(broadcast)(0);
    for (int k = 0; k < KICKED; ++k)
        weight[k] = l->bar.now.y[kicked[k]];
    for (int e = 0; e < Y; ++e)
        y_bar[e] = TYPED(broadcast)(0);
#if GS_MOMENTUM_FORCES
    const NUMBER t[1] = { l->s.t + l->s.kick_time[i] }, gradient[1] = { l->s.gradient[i] };
    NUMBER middle[Y], rate[KICKED + 1];
    TYPED(kick_rate)(l->c, at->q, at->y, t, gradient, rate);
    for (int e = 0; e < Y; ++e)
        middle[e] = at->y[e];
    for (int k = 0; k < KICKED; ++k)
        middle[kicked[k]] += (real)0.5*duration*rate[k];
    l->bar.kick[i] += share*TYPED(kick_rate_adjoint)(l, i, duration, at->q, middle, weight, y_bar,
        c_bar);
    for (int k = 0; k < KICKED; ++k)
        weight[k] = y_bar[kicked[k]];
    l->bar.kick[i] += (real)0.5*share*TYPED(kick_rate_adjoint)(l, i, (real)0.5*duration, at->q,
        at->y, weight, y_bar, c_bar);
#else
    l->bar.kick[i] += share*TYPED(kick_rate_adjoint)(l, i, duration, at->q, at->y, weight, y_bar,
        c_bar);
#endif
    for (int e = 0; e < Y; ++e)
        l->bar.now.y[e] += y_bar[e];
}

/* Of a rotation that does not commute with the drift, from the point at its start */
INLINE void TYPED(rotate_further_transposed)(TYPED(linearisation_t) *l, const step_map *map,
    const TYPED(flow_point) *at)
{
    const int k = map->rotation;
    const int *place = body_q[further_body[k]];
    NUMBER duration = map->share*l->s.kick[map->stage], duration_bar = TYPED(broadcast)(0);
    NUMBER q[4], q_bar[4];
    const TYPED(axis_turn) turn = { &l->s.further_rate[k], &l->s.further_offset[k],
        l->s.further_axis[k], &duration, &duration };
    const TYPED(axis_turn) bar = { &l->bar.further_rate[k], &l->bar.further_offset[k],
        l->bar.further_axis[k], &duration_bar, &duration_bar };
    TYPED(get_quaternion)(at->q, place, q);
    TYPED(get_quaternion)(l->bar.now.q, place, q_bar);
    TYPED(axis_turn_transposed)(further_which[k], &turn, q, at->y + 3*further_body[k], q_bar,
        l->bar.now.y + 3*further_body[k], &bar);
    TYPED(set_quaternion)(q_bar, place, l->bar.now.q);
    l->bar.kick[map->stage] += map->share*duration_bar;
}

#if GS_DRAG
/* d/dk of (1 - exp(-k a))/k = elapsed; a sum where k a is small. */
INLINE NUMBER TYPED(elapsed_slope)(NUMBER k, NUMBER a, NUMBER elapsed, NUMBER decay)
{
    const NUMBER x = k*a;
    const real value = *(const real *)(const void *)&x; /* the same in all lanes */
    if (value > (real)0.5 || value < (real)-0.5)
        return (a*decay - elapsed)/k;
    NUMBER sum = TYPED(broadcast)(0), power = TYPED(broadcast)(1);
    real share = (real)0.5; /* (j + 1)/(j + 2)! */
    for (int j = 0; j < 32; ++j) {
        sum += share*power;
        power *= -x;
        share *= (real)(j + 2)/((real)(j + 1)*(real)(j + 3));
    }
    return -a*a*sum;
}

/* Decays and times of free motions: their cotangents become those of drags and durations. */
static void TYPED(drag_transposed)(const TYPED(flows) *s, TYPED(flows) *bar)
{
    for (int e = 0; e < BODIES + FREE; ++e)
        for (int i = 0; i <= s->stages; ++i) {
            const NUMBER k = s->drag[e], a = s->drift[i], decay = s->decay[e][i];
            const NUMBER elapsed_bar = bar->elapsed[e][i], decay_bar = decay*bar->decay[e][i];
            bar->drag[e] += TYPED(elapsed_slope)(k, a, s->elapsed[e][i], decay)*elapsed_bar
                - a*decay_bar;
            bar->drift[i] += decay*elapsed_bar - k*decay_bar;
        }
}
#endif

/* The cotangent of the time step: durations are multiples of it, weights of gradients of h^2. */
INLINE NUMBER TYPED(step_cotangent)(const TYPED(flows) *s, const TYPED(flows) *bar)
{
    NUMBER sum = TYPED(broadcast)(0);
    for (int i = 0; i <= s->stages; ++i)
        sum += bar->drift[i]*s->drift[i];
    for (int i = 0; i < s->stages; ++i)
        sum += bar->kick[i]*s->kick[i] + 2*bar->gradient[i]*s->gradient[i]
            + bar->kick_time[i]*s->kick_time[i];
    return sum/s->h;
}

/* z <- the cotangent of the start of a step, of that of its end, w */
static int TYPED(step_adjoint)(TYPED(linearisation_t) *l, const NUMBER w[2*N],
    const NUMBER *multipliers, NUMBER z[Z])
{
    const int maps = maps_of(l->s.stages);
    const TYPED(flow_point) *end = &l->start[maps];
    TYPED(flows) *bar = &l->bar;
    NUMBER *members = (NUMBER *)(void *)bar, own[E];
    (void)multipliers; /* there are none */
    for (int e = 0; e < FLOW_NUMBERS; ++e)
        members[e] = TYPED(broadcast)(0);
    for (int e = 0; e < Z; ++e)
        z[e] = TYPED(broadcast)(0);
    for (int a = 0; a < N; ++a)
        bar->now.q[a] = w[a];
    for (int e = 0; e < FREE; ++e)
        bar->now.y[3*BODIES + e] = w[N + free_q[e]];
    for (int b = 0; BODIES > 0 && b < BODIES; ++b) { /* p = 2 l q */
        NUMBER q[4], p_bar[4], product[4];
        TYPED(get_quaternion)(end->q, body_q[b], q);
        TYPED(get_quaternion)(w + N, body_q[b], p_bar);
        TYPED(momentum_of)(p_bar, end->y + 3*b, product);
        for (int e = 0; e < 4; ++e)
            bar->now.q[body_q[b][e]] -= product[e];
        TYPED(angular_momentum_of)(q, p_bar, bar->now.y + 3*b);
        for (int e = 0; e < 3; ++e)
            bar->now.y[3*b + e] *= 4;
    }
    for (int m = maps - 1; m >= 0; --m) {
        const step_map map = map_of(l->is_symmetric, m);
        if (map.kind == DRIFT)
            TYPED(drift_transposed)(l, map.stage, &l->start[m], z + 2*N);
#if GS_ROTATING_AXES
        else if (map.kind == AXES_TURN)
            TYPED(rotate_axes_transposed)(l, map.stage, &l->start[m]);
#endif
        else if (map.kind == KICK)
            TYPED(kick_transposed)(l, map.stage, map.share, &l->start[m], z + 2*N);
        else if (FURTHER > 0)
            TYPED(rotate_further_transposed)(l, &map, &l->start[m]);
    }
    for (int a = 0; a < N; ++a)
        z[a] = bar->now.q[a];
    for (int e = 0; e < FREE; ++e)
        z[N + free_q[e]] = bar->now.y[3*BODIES + e];
    for (int b = 0; BODIES > 0 && b < BODIES; ++b) { /* 2 l = p times the conjugate of q */
        NUMBER r[4], p[4], by_q[4], by_p[4];
        TYPED(get_quaternion)(l->start[0].q, body_q[b], r);
        TYPED(get_quaternion)(l->p, body_q[b], p);
        TYPED(momentum_of)(p, bar->now.y + 3*b, by_q);
        TYPED(momentum_of)(r, bar->now.y + 3*b, by_p);
        for (int e = 0; e < 4; ++e) {
            z[body_q[b][e]] -= (real)0.25*by_q[e];
            z[N + body_q[b][e]] = (real)0.25*by_p[e];
        }
    }
#if GS_DRAG
    TYPED(drag_transposed)(&l->s, bar);
#endif
#if GS_ROTATING_AXES
    TYPED(space_transposed)(l, z + 2*N);
#endif
    TYPED(flow_rates_transposed)(l->c, bar->sphere, bar->axis_rate, bar->axis_offset,
        bar->further_rate, bar->further_offset, bar->drag, own);
    for (int e = 0; e < E; ++e)
        z[2*N + e] += own[e];
    TYPED(axis_directions_transposed)(l->c, (const NUMBER *)bar->axis,
        (const NUMBER *)bar->further_axis, own);
    for (int e = 0; e < E; ++e)
        z[2*N + e] += own[e];
    z[DT0] = bar->t;
    z[DH] = TYPED(step_cotangent)(&l->s, bar);
    return OK;
}
#endif
