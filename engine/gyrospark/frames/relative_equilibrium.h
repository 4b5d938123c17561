/* Detection of relative equilibria, whose round-off drift is suppressed. */

#if GS_SPARK
/* H_p and H_q - F of a state. */
static void SOLVER(rates_of)(const SOLVER(t) *w, const lanes q[N], const lanes p[N], lanes H_p[N],
    lanes H_q[N])
{
    lanes shared[SHARED];
    first_rates(&w->constants, q, p, H_p, shared);
    second_rates(&w->constants, q, p, &w->t, shared, H_p, H_q);
}
#else
/* H_p and H_q - F of a state. */
static void SOLVER(rates_of)(const SOLVER(t) *w, const lanes q[N], const lanes p[N], lanes H_p[N],
    lanes H_q[N])
{
    lanes zero[N];
    for (int a = 0; a < N; ++a)
        zero[a] = splat(0);
    lanes_mean_velocity(&w->constants, q, p, zero, zero, H_p);
    lanes_mean_force(&w->constants, q, p, zero, zero, &w->t, H_q);
}
#endif

/* The state, and what rounding left over. */
typedef struct {
    lanes q[N], p[N], q_low[N], p_low[N];
} SOLVER(place);

INLINE SOLVER(place) SOLVER(here)(const SOLVER(t) *w)
{
    SOLVER(place) now;
    for (int a = 0; a < N; ++a) {
        now.q[a] = w->q[a];
        now.p[a] = w->p[a];
        now.q_low[a] = w->q_low[a];
        now.p_low[a] = w->p_low[a];
    }
    return now;
}

/*
 * How far rounding may take a step, squared, in each set of coordinates that turn into each other:
 * what nudges of the state and of its rates do, the mean of four times.
 */
static void SOLVER(wander)(const SOLVER(t) *w, const SOLVER(place) *at, lanes q_way[N], lanes p_way[N])
{
    lanes H_p[N], H_q[N];
    unsigned chance = 1;
    SOLVER(rates_of)(w, at->q, at->p, H_p, H_q);
    for (int a = 0; a < N; ++a)
        q_way[a] = p_way[a] = splat(0);
    for (int attempt = 0; attempt < 4; ++attempt) {
        lanes q[N], p[N], H_p_near[N], H_q_near[N];
        for (int a = 0; a < N; ++a) {
            q[a] = at->q[a] + nudge(&chance)*at->q[a];
            p[a] = at->p[a] + nudge(&chance)*at->p[a];
        }
        SOLVER(rates_of)(w, q, p, H_p_near, H_q_near);
        for (int a = 0; a < N; ++a) {
            const lanes by_p = H_p_near[a] - H_p[a] + nudge(&chance)*H_p[a];
            const lanes by_q = H_q_near[a] - H_q[a] + nudge(&chance)*H_q[a];
            q_way[set_of[a]] += (real)0.25*w->h*w->h*by_p*by_p;
            p_way[set_of[a]] += (real)0.25*w->h*w->h*by_q*by_q;
        }
    }
}

/* From here on a state is looked at anew. */
static void SOLVER(wake)(SOLVER(t) *w)
{
    for (int i = 0; i < LANES; ++i)
        w->still[i] = 0;
}

/* Notes the lanes whose last step came no further than rounding does. */
static void SOLVER(watch)(SOLVER(t) *w, const SOLVER(place) *before)
{
    const real most = 65536*epsilon;
    lanes dq[N], dp[N], q_way[N], p_way[N], far = splat(0);
    int any = 0, lasting[LANES];
    for (int a = 0; a < N; ++a) {
        const lanes way = w->q[a] - before->q[a], push = w->p[a] - before->p[a];
        far += way*way*w->q_size + push*push*w->p_size;
        dq[a] = dp[a] = splat(0);
    }
    for (int i = 0; i < LANES; ++i) {
        lasting[i] = LASTS && w->still[i];
        w->still[i] = lasting[i] || part(&far, i) < most*most;
        any |= w->still[i] && !lasting[i];
    }
    if (!any)
        return;
    for (int a = 0; a < N; ++a) {
        const lanes way = w->q[a] - before->q[a] + (w->q_low[a] - before->q_low[a]);
        const lanes push = w->p[a] - before->p[a] + (w->p_low[a] - before->p_low[a]);
        dq[set_of[a]] += way*way;
        dp[set_of[a]] += push*push;
    }
    SOLVER(wander)(w, before, q_way, p_way);
    for (int i = 0; i < LANES; ++i)
        for (int a = 0; a < N && !lasting[i]; ++a)
            w->still[i] &= part(&dq[a], i) <= 64*part(&q_way[a], i)
                && part(&dp[a], i) <= 64*part(&p_way[a], i);
}

/*
 * On a relative equilibrium nothing is left of the rates but rounding. Where a step came no further
 * than sixteen units in the last place of the state account for, as little as sweeps may leave, a
 * state as near as that stands still, and so does this one, in all steps to come: it would stray
 * otherwise, for what rounding does adds up.
 */
static void SOLVER(stand)(SOLVER(t) *w, const SOLVER(place) *before)
{
    SOLVER(watch)(w, before);
    for (int i = 0; i < LANES; ++i)
        for (int a = 0; a < N && w->still[i]; ++a) {
            set_part(&w->q[a], i, part(&before->q[a], i));
            set_part(&w->p[a], i, part(&before->p[a], i));
            set_part(&w->q_low[a], i, part(&before->q_low[a], i));
            set_part(&w->p_low[a], i, part(&before->p_low[a], i));
        }
}
