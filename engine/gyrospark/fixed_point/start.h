/* Start of a run and scales of a step, of SPARK and of IMS and EMS. */

/*
 * w->round_off: estimate of the round-off in one iteration, as a squared change relative to the
 * state. The rates are evaluated at four random perturbations of the state by 2 ulp and are
 * perturbed by 2 ulp themselves; the estimate is the mean squared difference. The state is the
 * start of the step, because the iterates may be far from the solution.
 */
NOINLINE void SOLVER(estimate_round_off)(SOLVER(t) *w)
{
    w->round_off = splat(0);
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes H_p[N], H_q[N], dq = splat(0), dp = splat(0);
        unsigned seed = 1;
#if GS_SPARK
        const lanes t = w->t + w->stage_time[i];
#else
        const lanes t = w->t + (real)0.5*w->h;
#endif
        IF_TIME(lanes_at_time(&w->constants, t);)
        SOLVER(rates_at)(w, &t, w->q, w->p, H_p, H_q);
        for (int sample = 0; sample < 4; ++sample) {
            lanes position[N], momentum[N], H_p_perturbed[N], H_q_perturbed[N];
            for (int a = 0; a < N; ++a) {
                position[a] = w->q[a] + perturbation(&seed)*w->q[a];
                momentum[a] = w->p[a] + perturbation(&seed)*w->p[a];
            }
            SOLVER(rates_at)(w, &t, position, momentum, H_p_perturbed, H_q_perturbed);
            for (int a = 0; a < MEASURED; ++a) {
                const lanes by_p = H_p_perturbed[a] - H_p[a] + perturbation(&seed)*H_p[a];
                const lanes by_q = H_q_perturbed[a] - H_q[a] + perturbation(&seed)*H_q[a];
                dq += by_p*by_p;
                dp += by_q*by_q;
            }
        }
#if GS_SPARK
        w->round_off += (real)0.25*(w->h_b[i]*w->h_b[i]*w->q_weight*dq
            + w->h_b_hat[i]*w->h_b_hat[i]*w->p_weight*dp);
#else
        w->round_off = (real)0.25*w->h*w->h*(w->q_weight*dq + w->p_weight*dp);
#endif
    }
}

/* Sets the constants and the step size of a lane. */
static void SOLVER(prepare)(SOLVER(t) *w, int lane, const constants *c, real h)
{
    set_constants(&w->constants, lane, c);
    lane_set(&w->h, lane, h);
    lane_set(&w->h_inverse, lane, 1/h);
}

/* Computes all that depends on the constants and step sizes; clears history and work. */
static void SOLVER(initialise)(SOLVER(t) *w)
{
#if GS_SPARK
    SOLVER(set_weights)(w);
    IF_CONSTRAINED(SOLVER(set_nodes)(w);)
    for (int a = 0; a < N; ++a)
        w->zero[a] = splat(0);
#endif
#if GS_CONSTANT_SCHUR
    SOLVER(prepare_schur)(w);
#endif
    IF_FRAME(SOLVER(release_equilibrium)(w);)
    SOLVER(reset_history)(w);
    for (int a = 0; a < N; ++a)
        w->q_low[a] = w->p_low[a] = splat(0);
    w->work = w->work_low = splat(0);
    IF_TIME(lanes_at_time(&w->constants, w->t);)
    w->constraint_state.defect = splat(0);
    IF_CONSTRAINED(SOLVER(evaluate_constraints)(w);)
}

/* The scales of changes: 1/(|q|^2 + |dq|^2), and the same for p. */
INLINE void SOLVER(update_scales)(SOLVER(t) *w)
{
    lanes q_square = splat(LIMIT(MIN)), p_square = splat(LIMIT(MIN));
    lanes q_increment = splat(0), p_increment = splat(0);
#if GS_SPARK
    lanes dq[N], dp[N];
    SOLVER(sum_rows)(S, N, w->now.x, dq);
    SOLVER(sum_rows)(S, N, w->now.x + SOLVER(HAT), dp);
#else
    const lanes *dq = w->now.x, *dp = w->now.x + SOLVER(HAT);
#endif
    for (int a = 0; a < MEASURED; ++a) {
        q_increment += dq[a]*dq[a];
        p_increment += dp[a]*dp[a];
        q_square += w->q[a]*w->q[a];
        p_square += w->p[a]*w->p[a];
    }
    w->q_weight = 1/(q_square + q_increment);
    w->p_weight = 1/(p_square + p_increment);
    w->step_squared = q_increment*w->q_weight + p_increment*w->p_weight;
}
