/* IMS and EMS (midpoint and energy-momentum scheme): the fixed-point iteration. */
#ifndef GS_MIDPOINT_FIXED_POINT_H
#define GS_MIDPOINT_FIXED_POINT_H

#include "gyrospark/predictor/recurrence.h"

#if GS_FACTORS
#include "gyrospark/simd/small_lu.h"
#endif

#define SOLVER(f) SINGLE(f)

#include "gyrospark/fixed_point/state.h"

/* The mean values (51) of the start and the end of the step. */
INLINE void SOLVER(mean_values)(const SOLVER(t) *w, const lanes *x, lanes *q_mean, lanes *p_mean)
{
    for (int a = 0; a < N; ++a) {
        q_mean[a] = w->q[a] + (real)0.5*x[a];
        p_mean[a] = w->p[a] + (real)0.5*x[SOLVER(HAT) + a];
    }
}

/* dq = h D_p between the state and the end x of the step. */
INLINE void SOLVER(position_increment)(const SOLVER(t) *w, lanes *x)
{
    lanes q_mean[N], p_mean[N], rate[N];
    SOLVER(mean_values)(w, x, q_mean, p_mean);
    lanes_mean_velocity(&w->constants, q_mean, p_mean, x, x + SOLVER(HAT), rate);
    for (int a = 0; a < N; ++a)
        x[a] = w->h*rate[a];
}

/* Sets the increment of momentum a; accumulates the squared norm of the change. */
INLINE void SOLVER(accumulate_increment)(const SOLVER(t) *w, int a, lanes force, lanes *x,
    lanes *q_change, lanes *p_change)
{
    x[SOLVER(HAT) + a] = force;
    const lanes dq = x[a] - w->now.x[a], dp = force - w->now.x[SOLVER(HAT) + a];
    if (a < MEASURED) {
        *q_change += dq*dq;
        *p_change += dp*dp;
    }
}

/* D_q - F, with F at the mean values and the midpoint in time. */
INLINE void SOLVER(evaluate_mean_force)(const SOLVER(t) *w, const lanes *x, lanes *rate)
{
    lanes q_mean[N], p_mean[N];
    const lanes t = w->t + (real)0.5*w->h;
    SOLVER(mean_values)(w, x, q_mean, p_mean);
    lanes_mean_force(&w->constants, q_mean, p_mean, x, x + SOLVER(HAT), &t, rate);
}

#if !GS_CONSTRAINED
/* dp from dq: Gauss-Seidel ordering. */
INLINE void SOLVER(update_rates)(SOLVER(t) *w, lanes *x, lanes *q_change, lanes *p_change)
{
    lanes rate[N];
    SOLVER(evaluate_mean_force)(w, x, rate);
    for (int a = 0; a < N; ++a)
        SOLVER(accumulate_increment)(w, a, -w->h*rate[a], x, q_change, p_change);
}
#endif

#if GS_CONSTRAINED
#include "gyrospark/fixed_point/schur.h"

#if GS_CONSTANT_SCHUR
/* impulse += 2 (h W)^-1 g */
INLINE void SOLVER(apply_schur_inverse)(const SOLVER(t) *w, lanes g[M], lanes *impulse)
{
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            impulse[mu] += 2*w->constraint_state.W_inverse[mu][nu]*g[nu];
}
#else
/* Factorises W = G H_pp G^T at the end of the step. */
INLINE void SOLVER(factorise_schur)(SOLVER(t) *w)
{
    lanes q[N], p[N];
    for (int a = 0; a < N; ++a) {
        q[a] = w->q[a] + w->now.x[a];
        p[a] = w->p[a] + w->now.x[SOLVER(HAT) + a];
    }
    lanes_schur(LANES_AT(&w->constants, w->t + w->step), q, p, w->now.factor[0]);
    lanes_factor(w->now.factor[0]);
}

/* impulse += 2 (h W)^-1 g */
INLINE void SOLVER(apply_schur_inverse)(SOLVER(t) *w, lanes g[M], lanes *impulse)
{
    lanes_substitute(w->now.factor[0], g);
    for (int mu = 0; mu < M; ++mu)
        impulse[mu] += 2*w->h_inverse*g[mu];
}
#endif

INLINE void SOLVER(begin_iteration)(SOLVER(t) *w)
{
    (void)w;
    IF_FACTORISED(SOLVER(factorise_schur)(w);)
}

/*
 * impulse += 2 (h W)^-1 g: corrects the impulses so that the end of the step satisfies g = 0. The
 * squared defect before the correction is stored for the convergence test.
 */
INLINE void SOLVER(correct_multipliers)(SOLVER(t) *w, lanes *x)
{
    lanes g[M];
    lanes_constraint_increment(&w->constants, w->q, x, g);
    w->constraint_state.defect = splat(0);
    for (int mu = 0; mu < M; ++mu) {
        g[mu] += w->constraint_state.g[mu];
        w->constraint_state.defect += g[mu]*g[mu]*w->constraint_state.row_weight[mu];
    }
    w->constraint_state.defect *= w->q_weight;
    SOLVER(apply_schur_inverse)(w, g, x + SOLVER(IMPULSE));
}

/* Multipliers of a lane: impulse/h. */
static void SOLVER(multipliers)(const SOLVER(t) *w, int lane, real *multipliers)
{
    for (int mu = 0; mu < M; ++mu)
        multipliers[mu] = lane_get(&w->now.x[SOLVER(IMPULSE) + mu], lane)/lane_get(&w->h, lane);
}

/* Corrects the impulses and both increments, then dp: Gauss-Seidel ordering. */
INLINE void SOLVER(update_rates)(SOLVER(t) *w, lanes *x, lanes *q_change, lanes *p_change)
{
    lanes q_mean[N], p_mean[N], rate[N];
    SOLVER(mean_values)(w, x, q_mean, p_mean);
#if GS_ELEMENTS
    lanes correction[M], force[N], at[N];
    SOLVER(correct_multipliers)(w, x);
    for (int mu = 0; mu < M; ++mu)
        correction[mu] = x[SOLVER(IMPULSE) + mu] - w->now.x[SOLVER(IMPULSE) + mu];
    lanes_mean_pull(&w->constants, q_mean, x, correction, force);
    for (int a = 0; a < N; ++a)
        x[SOLVER(HAT) + a] -= force[a];
#else
    lanes G[M][N];
    lanes_mean_constraint(&w->constants, q_mean, x, G);
    SOLVER(correct_multipliers)(w, x);
    for (int mu = 0; mu < M; ++mu)
        for (int a = 0; a < N; ++a) {
            const int e = SOLVER(IMPULSE) + mu;
            const lanes reaction = G[mu][a]*(x[e] - w->now.x[e]);
            x[SOLVER(HAT) + a] -= reaction;
#if GS_SCALAR_SCHUR /* H_pp G^T = c G^T: the velocity changes by c times the change of momentum */
            x[a] -= (real)0.5*w->h*w->constraint_state.correction*reaction;
#endif
        }
#endif
#if !GS_SCALAR_SCHUR
    SOLVER(position_increment)(w, x);
#endif
    SOLVER(evaluate_mean_force)(w, x, rate);
#if GS_ELEMENTS
    SOLVER(mean_values)(w, x, at, p_mean);
    lanes_mean_pull(&w->constants, at, x, x + SOLVER(IMPULSE), force);
    for (int a = 0; a < N; ++a)
        SOLVER(accumulate_increment)(w, a, -w->h*rate[a] - force[a], x, q_change, p_change);
#else
    for (int a = 0; a < N; ++a) {
        lanes force = -w->h*rate[a];
        for (int mu = 0; mu < M; ++mu)
            force -= G[mu][a]*x[SOLVER(IMPULSE) + mu];
        SOLVER(accumulate_increment)(w, a, force, x, q_change, p_change);
    }
#endif
}
#endif

#if GS_TIME_DEPENDENT && GS_CONSTRAINED
/* lambda.g_t: power of the rheonomic constraints, with the discrete derivative g_t of the step */
INLINE lanes SOLVER(constraint_power)(const SOLVER(t) *w, const lanes *q_mean)
{
    lanes rate[M], sum = splat(0);
    lanes_mean_constraint_rate(&w->constants, q_mean, w->now.x, rate);
    for (int mu = 0; mu < M; ++mu)
        sum += w->h_inverse*w->now.x[SOLVER(IMPULSE) + mu]*rate[mu];
    return sum;
}
#endif

#if GS_FORCES
/*
 * work += F.dq; EMS takes F at the mean velocity dq/h. With a discrete gradient, H changes by exactly
 * this work. In scaled time it is the decrease of the momentum of t.
 */
INLINE void SOLVER(add_work)(SOLVER(t) *w)
{
    lanes done = splat(0), total;
#if GS_CLOCK
    done -= w->now.x[SOLVER(HAT) + N - 1];
#else
    lanes q_mean[N], p_mean[N], F[N];
    IF_FRAME_WORK(lanes v[N];)
    const lanes t = w->t + (real)0.5*w->h;
    SOLVER(mean_values)(w, w->now.x, q_mean, p_mean);
#if GS_ENERGY_MOMENTUM
    lanes velocity[N];
    for (int a = 0; a < N; ++a)
        velocity[a] = w->h_inverse*w->now.x[a];
    lanes_force_of_velocity(LANES_BETWEEN(&w->constants, w->t, w->step), q_mean, velocity, &t, F);
#else
    lanes_applied_force(LANES_BETWEEN(&w->constants, w->t, w->step), q_mean, p_mean, &t, F);
#endif
    for (int a = 0; a < N; ++a)
        done += F[a]*w->now.x[a];
    IF_FRAME_WORK(lanes_frame_velocity(&w->constants, q_mean, v);)
    IF_FRAME_WORK(for (int a = 0; a < N; ++a))
        IF_FRAME_WORK(done += w->h*F[a]*v[a];)
    IF_TIME(done += w->step*lanes_mean_energy_rate(&w->constants, q_mean, p_mean, w->now.x,
        w->now.x + SOLVER(HAT));)
    IF_TIME(IF_CONSTRAINED(done += w->step*SOLVER(constraint_power)(w, q_mean);))
#endif
    two_sum(w->work, done + w->work_low, &total, &w->work_low);
    w->work = total;
}
#endif

#if GS_FRAME
#include "gyrospark/frames/relative_equilibrium.h"
#endif

/* Explicit Euler start, without a history: zero impulses. */
INLINE void SOLVER(euler_start)(SOLVER(t) *w)
{
    lanes rates[2*N], zero[N];
    for (int a = 0; a < N; ++a)
        zero[a] = splat(0);
    lanes_mean_velocity(LANES_AT(&w->constants, w->t), w->q, w->p, zero, zero, rates);
    lanes_mean_force(&w->constants, w->q, w->p, zero, zero, &w->t, rates + N);
    for (int a = 0; a < N; ++a) {
        w->now.x[a] = w->h*rates[a];
        w->now.x[SOLVER(HAT) + a] = -w->h*rates[N + a];
    }
    for (int e = SOLVER(IMPULSE); e < SOLVER(X); ++e)
        w->now.x[e] = splat(0);
}

/*
 * One fixed-point iteration, Gauss-Seidel ordering: dq from dp, the impulses from g = 0 at the end
 * of the step, corrections of dq and dp, dp from both. w->change is the squared norm of the change,
 * relative to the state.
 */
INLINE void SOLVER(iterate_once)(SOLVER(t) *w)
{
    lanes x[SOLVER(X)], q_change = splat(0), p_change = splat(0);
    for (int e = 0; e < SOLVER(X); ++e)
        x[e] = w->now.x[e];
    IF_TIME(lanes_between(&w->constants, w->t, w->step);)
    SOLVER(position_increment)(w, x);
    SOLVER(update_rates)(w, x, &q_change, &p_change);
    for (int e = 0; e < SOLVER(X); ++e)
        w->now.x[e] = x[e];
    w->change = q_change*w->q_weight + p_change*w->p_weight;
}

/* The end of the step, by compensated summation. */
INLINE_IF_SMALL void SOLVER(finish)(SOLVER(t) *w)
{
    IF_FRAME(const SOLVER(state) before = SOLVER(current_state)(w);)
    lanes q[N], p[N];
    IF_FORCES(SOLVER(add_work)(w);)
    for (int a = 0; a < N; ++a) {
        two_sum(w->q[a], w->now.x[a] + w->q_low[a], &q[a], &w->q_low[a]);
        two_sum(w->p[a], w->now.x[SOLVER(HAT) + a] + w->p_low[a], &p[a], &w->p_low[a]);
        w->q[a] = q[a];
        w->p[a] = p[a];
    }
    IF_TIME(lanes_at_time(&w->constants, w->t + w->step);)
    IF_FRAME(SOLVER(hold_equilibrium)(w, &before);)
    IF_CONSTRAINED(SOLVER(evaluate_constraints)(w);)
}

#if GS_CLOCK
/* 1 if the time advances in the step of a lane. */
static int SOLVER(time_advances)(const SOLVER(t) *w, int lane)
{
    return lane_get(&w->now.x[N - 1], lane)*lane_get(&w->h, lane) > 0;
}
#endif

/* Clears the history. */
static void SOLVER(reset_history)(SOLVER(t) *w)
{
    reset_predictor(&w->predictor);
}

#include "gyrospark/fixed_point/start.h"

/* Computes the starting values of the next step and the factors of W. */
NOINLINE void SOLVER(start_iteration)(SOLVER(t) *w, int start)
{
    if (start == PREDICTED) {
        const lanes *x = history_entry(&w->predictor, w->history, SOLVER(X), 0);
        for (int e = 0; e < SOLVER(X) && !w->predictor.fitted; ++e)
            w->extrapolated[e] = x[e];
        predict(&w->predictor, w->history, SOLVER(X), SOLVER(group_ends), w->extrapolated,
            w->now.x);
    } else
        SOLVER(euler_start)(w);
    SOLVER(update_scales)(w);
    IF_CONSTRAINED(SOLVER(begin_iteration)(w);)
}

/* Appends the completed step to the history. */
INLINE void SOLVER(record_step)(SOLVER(t) *w)
{
    record_values(&w->predictor, w->history, SOLVER(X), SOLVER(group_ends), SOLVER(group_rows),
        w->extrapolated, w->now.x);
}

/* Unknowns of Newton's method (multipliers) from those of the iteration (impulses), and back. */
static void SOLVER(get_unknowns)(const SOLVER(t) *w, real x[U])
{
    for (int e = 0; e < SOLVER(X); ++e)
        x[e] = lane_get(&w->now.x[e], 0)/(e < SOLVER(IMPULSE) ? 1 : lane_get(&w->h, 0));
}

static void SOLVER(set_unknowns)(SOLVER(t) *w, int lane, const real x[U])
{
    for (int e = 0; e < SOLVER(X); ++e)
        lane_set(&w->now.x[e], lane, x[e]*(e < SOLVER(IMPULSE) ? 1 : lane_get(&w->h, lane)));
}

#undef SOLVER

#endif
