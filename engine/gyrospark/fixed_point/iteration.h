/* SPARK: the fixed-point iteration, and the end of the step. */

/* Explicit Euler start, without a history: the rates at the start of the step, zero impulses. */
INLINE void SOLVER(euler_start)(SOLVER(t) *w)
{
    lanes H_q[N], H_p[N], shared[SHARED];
    first_rates(LANES_AT(&w->constants, w->t), w->q, w->p, H_p, shared);
    second_rates(&w->constants, w->q, w->p, &w->t, shared, H_p, H_q);
    for (int i = 0; i < SOLVER(S); ++i)
        for (int a = 0; a < N; ++a) {
            w->now.x[i*N + a] = w->h_b[i]*H_p[a];
            w->now.x[SOLVER(HAT) + i*N + a] = -w->h_b_hat[i]*H_q[a];
        }
    for (int e = SOLVER(IMPULSE); e < SOLVER(X); ++e)
        w->now.x[e] = splat(0);
}

/* One fixed-point iteration; w->change: squared norm of the increment, relative to the state. */
INLINE void SOLVER(iterate_once)(SOLVER(t) *w)
{
    lanes Q[SOLVER(S)*N], momentum[SOLVER(S)*N], L_new[SOLVER(S)*N], shared[SOLVER(S)][SHARED];
    lanes q_change = splat(0), p_change = splat(0);
    SOLVER(stage_positions)(w, w->now.x, Q);
    SOLVER(stage_momenta)(w, w->now.x + SOLVER(HAT), momentum);
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes H_p[N];
        first_rates(LANES_AT(&w->constants,
            w->t + w->stage_time[i]), Q + i*N, momentum + i*N, H_p, shared[i]);
        for (int a = 0; a < N; ++a)
            L_new[i*N + a] = w->h_b[i]*H_p[a];
    }
    SOLVER(update_rates)(w, Q, momentum, L_new, shared, &q_change, &p_change);
    w->change = q_change*w->q_weight + p_change*w->p_weight;
}

/* T2: the end of the step from the converged stages, in compensated sums. */
INLINE_IF_SMALL void SOLVER(finish)(SOLVER(t) *w)
{
    IF_FRAME(const SOLVER(state) before = SOLVER(current_state)(w);)
    lanes dq[N], dp[N], q[N], p[N];
#if GS_FORCES && !GS_CLOCK
    SOLVER(add_work)(w);
#endif
    SOLVER(sum_rows)(S, N, w->now.x, dq);
    SOLVER(sum_rows)(S, N, w->now.x + SOLVER(HAT), dp);
    SOLVER(add_impulses)(w, dp);
    for (int a = 0; a < N; ++a) {
        dq[a] += w->q_low[a];
        two_sum(w->q[a], dq[a], &q[a], &w->q_low[a]);
        w->q[a] = q[a];
    }
    IF_TIME(lanes_at_time(&w->constants, w->t + w->step);)
    IF_CONSTRAINED(SOLVER(project_momentum_increment)(w, q, dp);)
#if GS_CLOCK && GS_FORCES
    const lanes momentum = w->p[N - 1];
#endif
    for (int a = 0; a < N; ++a) {
        two_sum(w->p[a], dp[a], &p[a], &w->p_low[a]);
        w->p[a] = p[a];
    }
#if GS_CLOCK && GS_FORCES
    SOLVER(add_to_work)(w, momentum - w->p[N - 1]);
#endif
    IF_TIME(IF_CONSTRAINED(SOLVER(add_final_constraint_work)(w);))
    IF_FRAME(SOLVER(hold_equilibrium)(w, &before);)
    IF_CONSTRAINED(SOLVER(evaluate_constraints)(w);)
}

#if GS_CLOCK
/* 1 if t' > 0 at all stages of the trajectory in a lane. */
static int SOLVER(time_advances)(const SOLVER(t) *w, int lane)
{
    int advances = 1;
    for (int i = 0; i < S; ++i) {
        const int item = i/SOLVER(PER), at = lane + i % SOLVER(PER);
        advances &= lane_get(&w->now.x[item*N + N - 1], at)*lane_get(&w->h_b[item], at) > 0;
    }
    return advances;
}
#endif

#include "gyrospark/fixed_point/start.h"

/* Scales the step size by a power of two; the inverse restores the bits of all weights. */
static void SOLVER(scale_step)(SOLVER(t) *w, real factor)
{
    w->h *= factor;
    w->h_inverse /= factor;
    IF_TIME(w->step *= factor;)
    SOLVER(set_weights)(w);
#if GS_CONSTANT_SCHUR
    SOLVER(prepare_schur)(w);
#endif
}

/*
 * Doubles the step size; the starting values are the polynomial through the rates at the stages of
 * the shorter step, l_j the Lagrange polynomials of the nodes:
 * 2h b_i k_i = sum_j 2 b_i/b_j l_j(2 c_i) h b_j k_j.
 */
static void SOLVER(double_step)(SOLVER(t) *w)
{
    real weights[S][S];
    for (int i = 0; i < S; ++i)
        for (int j = 0; j < S; ++j) {
            weights[i][j] = 2*tableau.b[i]/tableau.b[j];
            for (int k = 0; k < S; ++k)
                if (k != j)
                    weights[i][j] *= (2*tableau.c[i] - tableau.c[k])/(tableau.c[j] - tableau.c[k]);
        }
#if GS_STAGES_IN_LANES
    lanes table[S*SOLVER(S)];
    SOLVER(fill)(table, S, S, &weights[0][0]);
#else
    const real *table = &weights[0][0];
#endif
    SOLVER(scale_step)(w, 2);
    SOLVER(stages_of_stages)(w->zero, 0, table, w->now.x, w->extrapolated);
    SOLVER(stages_of_stages)(w->zero, 0, table, w->now.x + SOLVER(HAT),
        w->extrapolated + SOLVER(HAT));
    for (int e = 0; e < SOLVER(X); ++e)
        w->now.x[e] = e < SOLVER(IMPULSE) ? w->extrapolated[e] : 2*w->now.x[e];
}

/* Computes the starting values of the next step and their constraint forces. */
NOINLINE void SOLVER(start_iteration)(SOLVER(t) *w, int start)
{
    if (start == PREDICTED)
        SOLVER(predict_unknowns)(w);
    else if (start == FROM_HALF_STEP)
        SOLVER(double_step)(w);
    else {
        if (start == QUARTER_STEP)
            SOLVER(scale_step)(w, (real)0.25);
        SOLVER(euler_start)(w);
    }
    SOLVER(update_scales)(w);
    IF_CONSTRAINED(SOLVER(begin_iteration)(w);)
}

/* Sets the scaled unknowns of a lane from the unknowns (B.2). */
static void SOLVER(set_unknowns)(SOLVER(t) *w, int lane, const real x[U])
{
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a) {
            const int item = i/SOLVER(PER), position = item*N + a, at = lane + i % SOLVER(PER);
            const lanes *h_b = &w->h_b[item], *h_b_hat = &w->h_b_hat[item];
            lane_set(&w->now.x[position], at, x[i*N + a]*lane_get(h_b, at));
            lane_set(&w->now.x[SOLVER(HAT) + position], at,
                x[K_HAT + i*N + a]*lane_get(h_b_hat, at));
        }
    IF_CONSTRAINED(SOLVER(set_impulses)(w, lane, x + LAMBDA);)
}
