/* Starting values without a past: the rates at the start of the step, no impulse. */
INLINE void RUN(guess)(RUN(t) *w)
{
    lanes H_q[N], H_p[N], shared[SHARED];
    first_rates(LANES_AT(&w->constants, w->t), w->q, w->p, H_p, shared);
    second_rates(&w->constants, w->q, w->p, &w->t, shared, H_p, H_q);
    for (int i = 0; i < RUN(S); ++i)
        for (int a = 0; a < N; ++a) {
            w->now.x[i*N + a] = w->hb[i]*H_p[a];
            w->now.x[RUN(HAT) + i*N + a] = -w->hb_hat[i]*H_q[a];
        }
    for (int e = RUN(IMPULSE); e < RUN(X); ++e)
        w->now.x[e] = splat(0);
}

/* One sweep; w->change is the sum of squares of what it changed, relative to the state. */
INLINE void RUN(sweep)(RUN(t) *w)
{
    lanes Q[RUN(S)*N], momentum[RUN(S)*N], L_new[RUN(S)*N], shared[RUN(S)][SHARED];
    lanes q_change = splat(0), p_change = splat(0);
    RUN(places)(w, w->now.x, Q);
    RUN(momenta)(w, w->now.x + RUN(HAT), momentum);
    for (int i = 0; i < RUN(S); ++i) {
        lanes H_p[N];
        first_rates(LANES_AT(&w->constants,
            w->t + w->late[i]), Q + i*N, momentum + i*N, H_p, shared[i]);
        for (int a = 0; a < N; ++a)
            L_new[i*N + a] = w->hb[i]*H_p[a];
    }
    RUN(follow)(w, Q, momentum, L_new, shared, &q_change, &p_change);
    w->change = q_change*w->q_size + p_change*w->p_size;
}

/* H_p and H_q - F of the stages of item i at given places and momenta. */
INLINE void RUN(rates)(const RUN(t) *w, int i, const lanes *Q, const lanes *momentum, lanes *H_p,
    lanes *H_q)
{
    lanes shared[SHARED];
    const lanes t = w->t + w->late[i];
    first_rates(&w->constants, Q, momentum, H_p, shared);
    second_rates(&w->constants, Q, momentum, &t, shared, H_p, H_q);
}

/*
 * What rounding is worth in a sweep, w->noise: the squared difference, relative to the state, that
 * it makes to the rates when a state is moved by two units in the last place, the mean of four
 * times, and what rounding the rates makes. The state is that at the start of the step, for sweeps
 * that have gone astray prove nothing.
 */
NOINLINE void RUN(noise)(RUN(t) *w)
{
    w->noise = splat(0);
    for (int i = 0; i < RUN(S); ++i) {
        lanes H_p[N], H_q[N], dq = splat(0), dp = splat(0);
        unsigned chance = 1;
        TIMED(lanes_at_time(&w->constants, w->t + w->late[i]);)
        RUN(rates)(w, i, w->q, w->p, H_p, H_q);
        for (int attempt = 0; attempt < 4; ++attempt) {
            lanes place[N], push[N], H_p_near[N], H_q_near[N];
            for (int a = 0; a < N; ++a) {
                place[a] = w->q[a] + nudge(&chance)*w->q[a];
                push[a] = w->p[a] + nudge(&chance)*w->p[a];
            }
            RUN(rates)(w, i, place, push, H_p_near, H_q_near);
            for (int a = 0; a < N; ++a) {
                const lanes by_p = H_p_near[a] - H_p[a] + nudge(&chance)*H_p[a];
                const lanes by_q = H_q_near[a] - H_q[a] + nudge(&chance)*H_q[a];
                dq += by_p*by_p;
                dp += by_q*by_q;
            }
        }
        w->noise += (real)0.25*(w->hb[i]*w->hb[i]*w->q_size*dq
            + w->hb_hat[i]*w->hb_hat[i]*w->p_size*dp);
    }
}

/* T2: the end of the step from the converged stages, in compensated sums. */
INLINE void RUN(finish)(RUN(t) *w)
{
    TURNED(const RUN(place) before = RUN(here)(w));
    lanes dq[N], dp[N], q[N], p[N];
    RUN(add_work)(w);
    RUN(total)(S, N, w->now.x, dq);
    RUN(total)(S, N, w->now.x + RUN(HAT), dp);
    RUN(add_impulses)(w, dp);
    for (int a = 0; a < N; ++a) {
        dq[a] += w->q_low[a];
        two_sum(w->q[a], dq[a], &q[a], &w->q_low[a]);
        w->q[a] = q[a];
    }
    TIMED(lanes_at_time(&w->constants, w->t + w->span);)
    RUN(land)(w, q, dp);
    for (int a = 0; a < N; ++a) {
        two_sum(w->p[a], dp[a], &p[a], &w->p_low[a]);
        w->p[a] = p[a];
    }
    TIMED(RUN(add_last_drive)(w);)
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

/* What follows from the constants and steps of all lanes. */
static void RUN(set_up)(RUN(t) *w)
{
    RUN(set_weights)(w);
    RUN(set_nodes)(w);
    RUN(set_schur)(w);
    TURNED(RUN(wake)(w));
    RUN(forget)(w);
    for (int a = 0; a < N; ++a)
        w->q_low[a] = w->p_low[a] = w->zero[a] = splat(0);
    w->work = w->work_low = splat(0);
    TIMED(lanes_at_time(&w->constants, w->t);)
    RUN(look)(w);
}

/* What changes are relative to: the state and the step's own length. */
INLINE void RUN(sizes)(RUN(t) *w)
{
    lanes dq[N], dp[N], q_square = splat(LIMIT(MIN)), p_square = splat(LIMIT(MIN));
    lanes q_way = splat(0), p_way = splat(0);
    RUN(total)(S, N, w->now.x, dq);
    RUN(total)(S, N, w->now.x + RUN(HAT), dp);
    for (int a = 0; a < N; ++a) {
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
    if (predicted)
        RUN(foresee)(w);
    else
        RUN(guess)(w);
    RUN(sizes)(w);
    RUN(begin)(w);
}
