/* Detection of relative equilibria, to suppress their round-off drift. */

/* The state and the low words of its compensated sums. */
typedef struct {
    lanes q[N], p[N], q_low[N], p_low[N];
} SOLVER(state);

INLINE SOLVER(state) SOLVER(current_state)(const SOLVER(t) *w)
{
    SOLVER(state) now;
    for (int a = 0; a < N; ++a) {
        now.q[a] = w->q[a];
        now.p[a] = w->p[a];
        now.q_low[a] = w->q_low[a];
        now.p_low[a] = w->p_low[a];
    }
    return now;
}

/*
 * Estimates the squared round-off drift of a step, for each group of coordinates that a rotation
 * mixes: the mean square response of dt H_p and dt H_q to four perturbations of state and rates.
 */
static void SOLVER(estimate_drift)(const SOLVER(t) *w, const SOLVER(state) *at, lanes q_drift[N],
    lanes p_drift[N])
{
    lanes H_p[N], H_q[N];
    unsigned seed = 1;
    SOLVER(rates_at)(w, &w->t, at->q, at->p, H_p, H_q);
    for (int a = 0; a < N; ++a)
        q_drift[a] = p_drift[a] = splat(0);
    for (int attempt = 0; attempt < 4; ++attempt) {
        lanes q[N], p[N], H_p_near[N], H_q_near[N];
        for (int a = 0; a < N; ++a) {
            q[a] = at->q[a] + perturbation(&seed)*at->q[a];
            p[a] = at->p[a] + perturbation(&seed)*at->p[a];
        }
        SOLVER(rates_at)(w, &w->t, q, p, H_p_near, H_q_near);
        for (int a = 0; a < N; ++a) {
            const lanes by_p = H_p_near[a] - H_p[a] + perturbation(&seed)*H_p[a];
            const lanes by_q = H_q_near[a] - H_q[a] + perturbation(&seed)*H_q[a];
            q_drift[rotation_group[a]] += (real)0.25*w->h*w->h*by_p*by_p;
            p_drift[rotation_group[a]] += (real)0.25*w->h*w->h*by_q*by_q;
        }
    }
}

/* Restarts the detection in all lanes. */
static void SOLVER(release_equilibrium)(SOLVER(t) *w)
{
    for (int i = 0; i < LANES; ++i)
        w->stationary[i] = 0;
}

/*
 * stationary[i] <- whether the increment of the last step of lane i is round-off: below 65536
 * epsilon of the state, and within a factor of 8 of the estimated drift in every group. The first
 * test is cheap. If RATES_STAY_ZERO (no forces, no inputs), a stationary lane remains stationary
 * until the run ends.
 */
static void SOLVER(detect_equilibrium)(SOLVER(t) *w, const SOLVER(state) *before)
{
    const real threshold = 65536*epsilon;
    lanes dq[N], dp[N], q_drift[N], p_drift[N], increment = splat(0);
    int any = 0, permanent[LANES];
    for (int a = 0; a < N; ++a) {
        const lanes dq_a = w->q[a] - before->q[a], dp_a = w->p[a] - before->p[a];
        increment += dq_a*dq_a*w->q_weight + dp_a*dp_a*w->p_weight;
        dq[a] = dp[a] = splat(0);
    }
    for (int i = 0; i < LANES; ++i) {
        permanent[i] = RATES_STAY_ZERO && w->stationary[i];
        w->stationary[i] = permanent[i] || lane_get(&increment, i) < threshold*threshold;
        any |= w->stationary[i] && !permanent[i];
    }
    if (!any)
        return;
    for (int a = 0; a < N; ++a) {
        const lanes dq_a = w->q[a] - before->q[a] + (w->q_low[a] - before->q_low[a]);
        const lanes dp_a = w->p[a] - before->p[a] + (w->p_low[a] - before->p_low[a]);
        dq[rotation_group[a]] += dq_a*dq_a;
        dp[rotation_group[a]] += dp_a*dp_a;
    }
    SOLVER(estimate_drift)(w, before, q_drift, p_drift);
    for (int i = 0; i < LANES; ++i)
        for (int a = 0; a < N && !permanent[i]; ++a)
            w->stationary[i] &= lane_get(&dq[a], i) <= 64*lane_get(&q_drift[a], i)
                && lane_get(&dp[a], i) <= 64*lane_get(&p_drift[a], i);
}

/*
 * Restores the state before the step in all stationary lanes. At a relative equilibrium the rates
 * are pure round-off. An increment that perturbations of the state by 16 ulp (the accuracy of the
 * fixed-point iteration) can explain is treated as zero; otherwise it would accumulate as a drift.
 */
static void SOLVER(hold_equilibrium)(SOLVER(t) *w, const SOLVER(state) *before)
{
    SOLVER(detect_equilibrium)(w, before);
    for (int i = 0; i < LANES; ++i)
        for (int a = 0; a < N && w->stationary[i]; ++a) {
            lane_set(&w->q[a], i, lane_get(&before->q[a], i));
            lane_set(&w->p[a], i, lane_get(&before->p[a], i));
            lane_set(&w->q_low[a], i, lane_get(&before->q_low[a], i));
            lane_set(&w->p_low[a], i, lane_get(&before->p_low[a], i));
        }
}
