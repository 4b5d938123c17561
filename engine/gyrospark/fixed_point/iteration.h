/* SPARK: one fixed-point iteration, and the end of the step. */

/* Starting values without a past: the rates at the start of the step, no impulse. */
INLINE void SOLVER(guess)(SOLVER(t) *w)
{
    lanes H_q[N], H_p[N], shared[SHARED];
    first_rates(LANES_AT(&w->constants, w->t), w->q, w->p, H_p, shared);
    second_rates(&w->constants, w->q, w->p, &w->t, shared, H_p, H_q);
    for (int i = 0; i < SOLVER(S); ++i)
        for (int a = 0; a < N; ++a) {
            w->now.x[i*N + a] = w->hb[i]*H_p[a];
            w->now.x[SOLVER(HAT) + i*N + a] = -w->hb_hat[i]*H_q[a];
        }
    for (int e = SOLVER(IMPULSE); e < SOLVER(X); ++e)
        w->now.x[e] = splat(0);
}

/* One sweep; w->change is the sum of squares of what it changed, relative to the state. */
INLINE void SOLVER(sweep)(SOLVER(t) *w)
{
    lanes Q[SOLVER(S)*N], momentum[SOLVER(S)*N], L_new[SOLVER(S)*N], shared[SOLVER(S)][SHARED];
    lanes q_change = splat(0), p_change = splat(0);
    SOLVER(places)(w, w->now.x, Q);
    SOLVER(momenta)(w, w->now.x + SOLVER(HAT), momentum);
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes H_p[N];
        first_rates(LANES_AT(&w->constants,
            w->t + w->late[i]), Q + i*N, momentum + i*N, H_p, shared[i]);
        for (int a = 0; a < N; ++a)
            L_new[i*N + a] = w->hb[i]*H_p[a];
    }
    SOLVER(follow)(w, Q, momentum, L_new, shared, &q_change, &p_change);
    w->change = q_change*w->q_size + p_change*w->p_size;
}

/* H_p and H_q - F of the stages of item i at given places and momenta. */
INLINE void SOLVER(rates)(const SOLVER(t) *w, int i, const lanes *Q, const lanes *momentum, lanes *H_p,
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
NOINLINE void SOLVER(noise)(SOLVER(t) *w)
{
    w->noise = splat(0);
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes H_p[N], H_q[N], dq = splat(0), dp = splat(0);
        unsigned chance = 1;
        IF_TIME(lanes_at_time(&w->constants, w->t + w->late[i]);)
        SOLVER(rates)(w, i, w->q, w->p, H_p, H_q);
        for (int attempt = 0; attempt < 4; ++attempt) {
            lanes place[N], push[N], H_p_near[N], H_q_near[N];
            for (int a = 0; a < N; ++a) {
                place[a] = w->q[a] + nudge(&chance)*w->q[a];
                push[a] = w->p[a] + nudge(&chance)*w->p[a];
            }
            SOLVER(rates)(w, i, place, push, H_p_near, H_q_near);
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
INLINE void SOLVER(finish)(SOLVER(t) *w)
{
    IF_FRAME(const SOLVER(place) before = SOLVER(here)(w);)
    lanes dq[N], dp[N], q[N], p[N];
    SOLVER(add_work)(w);
    SOLVER(total)(S, N, w->now.x, dq);
    SOLVER(total)(S, N, w->now.x + SOLVER(HAT), dp);
    SOLVER(add_impulses)(w, dp);
    for (int a = 0; a < N; ++a) {
        dq[a] += w->q_low[a];
        two_sum(w->q[a], dq[a], &q[a], &w->q_low[a]);
        w->q[a] = q[a];
    }
    IF_TIME(lanes_at_time(&w->constants, w->t + w->span);)
    SOLVER(land)(w, q, dp);
    for (int a = 0; a < N; ++a) {
        two_sum(w->p[a], dp[a], &p[a], &w->p_low[a]);
        w->p[a] = p[a];
    }
    IF_TIME(SOLVER(add_last_drive)(w);)
    IF_FRAME(SOLVER(stand)(w, &before);)
    SOLVER(look)(w);
}

/* Lane i of a run: its constants and time step. */
static void SOLVER(prepare)(SOLVER(t) *w, int lane, const constants *c, real h)
{
    set_constants(&w->constants, lane, c);
    set_part(&w->h, lane, h);
    set_part(&w->h_inverse, lane, 1/h);
}

/* What follows from the constants and steps of all lanes. */
static void SOLVER(set_up)(SOLVER(t) *w)
{
    SOLVER(set_weights)(w);
    SOLVER(set_nodes)(w);
    SOLVER(set_schur)(w);
    IF_FRAME(SOLVER(wake)(w);)
    SOLVER(forget)(w);
    for (int a = 0; a < N; ++a)
        w->q_low[a] = w->p_low[a] = w->zero[a] = splat(0);
    w->work = w->work_low = splat(0);
    IF_TIME(lanes_at_time(&w->constants, w->t);)
    SOLVER(look)(w);
}

/* What changes are relative to: the state and the step's own length. */
INLINE void SOLVER(sizes)(SOLVER(t) *w)
{
    lanes dq[N], dp[N], q_square = splat(LIMIT(MIN)), p_square = splat(LIMIT(MIN));
    lanes q_way = splat(0), p_way = splat(0);
    SOLVER(total)(S, N, w->now.x, dq);
    SOLVER(total)(S, N, w->now.x + SOLVER(HAT), dp);
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
NOINLINE void SOLVER(start)(SOLVER(t) *w, int predicted)
{
    if (predicted)
        SOLVER(foresee)(w);
    else
        SOLVER(guess)(w);
    SOLVER(sizes)(w);
    SOLVER(begin)(w);
}

/* The scaled unknowns of a lane from (B.2). */
static void SOLVER(load)(SOLVER(t) *w, int lane, const real x[U])
{
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a) {
            const int item = i/SOLVER(PER), place = item*N + a, at = lane + i % SOLVER(PER);
            const lanes *hb = &w->hb[item], *hb_hat = &w->hb_hat[item];
            set_part(&w->now.x[place], at, x[i*N + a]*part(hb, at));
            set_part(&w->now.x[SOLVER(HAT) + place], at, x[K_HAT + i*N + a]*part(hb_hat, at));
        }
    SOLVER(load_impulses)(w, lane, x + LAMBDA);
}
