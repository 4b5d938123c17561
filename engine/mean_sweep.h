/* Starting values without a past: an explicit Euler step, no impulse. */
INLINE void RUN(guess)(RUN(t) *w)
{
    lanes rates[2*N], zero[N];
    for (int a = 0; a < N; ++a)
        zero[a] = splat(0);
    lanes_mean_velocity(LANES_AT(&w->constants, w->t), w->q, w->p, zero, zero, rates);
    lanes_mean_force(&w->constants, w->q, w->p, zero, zero, &w->t, rates + N);
    for (int a = 0; a < N; ++a) {
        w->now.x[a] = w->h*rates[a];
        w->now.x[RUN(HAT) + a] = -w->h*rates[N + a];
    }
    for (int e = RUN(IMPULSE); e < RUN(X); ++e)
        w->now.x[e] = splat(0);
}

/*
 * One sweep, Gauss-Seidel: dq from dp, the impulses from the constraint at the end, both corrected,
 * dp from them. w->change is the sum of squares of what it changed, relative to the state.
 */
INLINE void RUN(sweep)(RUN(t) *w)
{
    lanes x[RUN(X)], q_change = splat(0), p_change = splat(0);
    for (int e = 0; e < RUN(X); ++e)
        x[e] = w->now.x[e];
    TIMED(lanes_between(&w->constants, w->t, w->span);)
    RUN(move)(w, x);
    RUN(follow)(w, x, &q_change, &p_change);
    for (int e = 0; e < RUN(X); ++e)
        w->now.x[e] = x[e];
    w->change = q_change*w->q_size + p_change*w->p_size;
}

/*
 * What rounding is worth in a sweep, w->noise: the squared difference, relative to the state, that
 * it makes to the rates when a state is moved by two units in the last place, the mean of four
 * times, and what rounding the rates makes. The state is that at the start of the step, for sweeps
 * that have gone astray prove nothing.
 */
NOINLINE void RUN(noise)(RUN(t) *w)
{
    lanes zero[N], H_p[N], H_q[N], dq = splat(0), dp = splat(0);
    unsigned chance = 1;
    const lanes t = w->t + (real)0.5*w->h;
    for (int a = 0; a < N; ++a)
        zero[a] = splat(0);
    lanes_mean_velocity(LANES_AT(&w->constants, t), w->q, w->p, zero, zero, H_p);
    lanes_mean_force(&w->constants, w->q, w->p, zero, zero, &t, H_q);
    for (int attempt = 0; attempt < 4; ++attempt) {
        lanes place[N], push[N], H_p_near[N], H_q_near[N];
        for (int a = 0; a < N; ++a) {
            place[a] = w->q[a] + nudge(&chance)*w->q[a];
            push[a] = w->p[a] + nudge(&chance)*w->p[a];
        }
        lanes_mean_velocity(&w->constants, place, push, zero, zero, H_p_near);
        lanes_mean_force(&w->constants, place, push, zero, zero, &t, H_q_near);
        for (int a = 0; a < N; ++a) {
            const lanes by_p = H_p_near[a] - H_p[a] + nudge(&chance)*H_p[a];
            const lanes by_q = H_q_near[a] - H_q[a] + nudge(&chance)*H_q[a];
            dq += by_p*by_p;
            dp += by_q*by_q;
        }
    }
    w->noise = (real)0.25*w->h*w->h*(w->q_size*dq + w->p_size*dp);
}

/* The end of the step, in compensated sums. */
INLINE void RUN(finish)(RUN(t) *w)
{
    TURNED(const RUN(place) before = RUN(here)(w));
    lanes q[N], p[N];
    RUN(add_work)(w);
    for (int a = 0; a < N; ++a) {
        two_sum(w->q[a], w->now.x[a] + w->q_low[a], &q[a], &w->q_low[a]);
        two_sum(w->p[a], w->now.x[RUN(HAT) + a] + w->p_low[a], &p[a], &w->p_low[a]);
        w->q[a] = q[a];
        w->p[a] = p[a];
    }
    TIMED(lanes_at_time(&w->constants, w->t + w->span);)
    TURNED(RUN(stand)(w, &before));
    RUN(look)(w);
}

/* Lane i of a run: its constants and time step. */
static void RUN(prepare)(RUN(t) *w, int lane, const constants *c, real h)
{
    set_constants(&w->constants, lane, c);
    set_part(&w->h, lane, h);
    set_part(&w->h_inverse, lane, 1/h);
}

/* What is known of the past. */
static void RUN(forget)(RUN(t) *w)
{
    forget(&w->predictor);
}

/* What follows from the constants and steps of all lanes. */
static void RUN(set_up)(RUN(t) *w)
{
    RUN(set_schur)(w);
    TURNED(RUN(wake)(w));
    RUN(forget)(w);
    for (int a = 0; a < N; ++a)
        w->q_low[a] = w->p_low[a] = splat(0);
    w->work = w->work_low = splat(0);
    TIMED(lanes_at_time(&w->constants, w->t);)
    RUN(look)(w);
}

/* What changes are relative to: the state and the step's own length. */
INLINE void RUN(sizes)(RUN(t) *w)
{
    lanes q_square = splat(LIMIT(MIN)), p_square = splat(LIMIT(MIN));
    lanes q_way = splat(0), p_way = splat(0);
    for (int a = 0; a < N; ++a) {
        const lanes *dq = w->now.x, *dp = w->now.x + RUN(HAT);
        q_way += dq[a]*dq[a];
        p_way += dp[a]*dp[a];
        q_square += w->q[a]*w->q[a];
        p_square += w->p[a]*w->p[a];
    }
    w->q_size = 1/(q_square + q_way);
    w->p_size = 1/(p_square + p_way);
    w->moved = q_way*w->q_size + p_way*w->p_size;
}

/* Starting values of the next step. */
NOINLINE void RUN(start)(RUN(t) *w, int predicted)
{
    if (predicted) {
        const lanes *x = past_values(&w->predictor, w->past, RUN(X), 0);
        for (int e = 0; e < RUN(X) && !w->predictor.fitted; ++e)
            w->through[e] = x[e];
        predict(&w->predictor, w->past, RUN(X), RUN(ends), w->through, w->now.x);
    } else
        RUN(guess)(w);
    RUN(sizes)(w);
    RUN(begin)(w);
}

/* Records the step just done. */
INLINE void RUN(remember)(RUN(t) *w)
{
    record(&w->predictor, w->past, RUN(X), RUN(ends), RUN(rows), w->through, w->now.x);
}

/* The unknowns from those of the sweeps, and those of a lane from them. */
static void RUN(unscale)(const RUN(t) *w, real x[U])
{
    for (int e = 0; e < RUN(X); ++e)
        x[e] = part(&w->now.x[e], 0)/(e < RUN(IMPULSE) ? 1 : part(&w->h, 0));
}

static void RUN(load)(RUN(t) *w, int lane, const real x[U])
{
    for (int e = 0; e < RUN(X); ++e)
        set_part(&w->now.x[e], lane, x[e]*(e < RUN(IMPULSE) ? 1 : part(&w->h, lane)));
}
