/* IMS and EMS: the fixed-point iteration. */
#ifndef GS_MIDPOINT_FIXED_POINT_H
#define GS_MIDPOINT_FIXED_POINT_H

#include "gyrospark/predictor/recurrence.h"

#if GS_FACTORS
#include "gyrospark/simd/small_lu.h"
#endif

#define SOLVER(f) SINGLE(f)

/* Where the unknowns stand: the increments dq and dp, and the impulses h lambda. */
enum { SOLVER(S) = 1, SOLVER(P) = 1 };
enum { SOLVER(HAT) = N, SOLVER(IMPULSE) = 2*N, SOLVER(X) = 2*N + M, SOLVER(RESULT) = SOLVER(X) };
static const int SOLVER(group_ends)[GROUPS] = { SOLVER(HAT), SOLVER(IMPULSE), SOLVER(X) };
static const int SOLVER(group_rows)[GROUPS] = { N, N, M };

#if !GS_CONSTRAINED
/* What a sweep improves. */
typedef struct {
    lanes x[SOLVER(X)];
} SOLVER(unknowns);

/* There are no constraints. */
typedef struct {
    lanes defect; /* none */
} SOLVER(constraint_state);
#endif

#if GS_CONSTRAINED
#if GS_CONSTANT_SCHUR
/* What a sweep improves: W is constant. */
typedef struct {
    lanes x[SOLVER(X)];
} SOLVER(unknowns);

/* What is known of the constraints. */
typedef struct {
    lanes defect;       /* of the constraints in the last sweep */
    lanes row_weight[M]; /* 1/|G_mu|^2 of the rows of G at the state */
    lanes g[M], g_rounded[M]; /* g at the state, with and without what rounding left over */
    lanes W_inverse[M][M]; /* by h */
    lanes correction;      /* c, with H_pp G^T = c G^T */
} SOLVER(constraint_state);
#else
/* What a sweep improves, and the factors of W at the end of the step. */
typedef struct {
    lanes x[SOLVER(X)];
    schur_t factor;
} SOLVER(unknowns);

/* What is known of the constraints. */
typedef struct {
    lanes defect;       /* of the constraints in the last sweep */
    lanes row_weight[M]; /* 1/|G_mu|^2 of the rows of G at the state */
    lanes g[M], g_rounded[M]; /* g at the state, with and without what rounding left over */
} SOLVER(constraint_state);
#endif
#endif

typedef struct {
    lanes_constants constants;
    lanes h, h_inverse;
    lanes q[N], p[N];         /* the state, rounded, */
    lanes q_low[N], p_low[N]; /* and what rounding left over */
    lanes q_weight, p_weight;     /* 1/(|q|^2 + |dq|^2), and of p: what changes are relative to */
    lanes step_squared;              /* |dq|^2 and |dp|^2 relative to these */
    lanes t;                  /* at the start of the step */
    IF_TIME(lanes step;)
    lanes work, work_low;     /* done by the forces since the start */
    lanes change, round_off;      /* of the last sweep; what rounding is worth in one */
    IF_FRAME(int stationary[LANES];)
    SOLVER(unknowns) now;
    SOLVER(constraint_state) constraint_state;
    predictor_t predictor;
    lanes extrapolated[SOLVER(X)]; /* what went before, once more */
    lanes history[HISTORY*SOLVER(X)];
} SOLVER(t);

/* The means of the ends (51). */
INLINE void SOLVER(mean_values)(const SOLVER(t) *w, const lanes *x, lanes *q_mean, lanes *p_mean)
{
    for (int a = 0; a < N; ++a) {
        q_mean[a] = w->q[a] + (real)0.5*x[a];
        p_mean[a] = w->p[a] + (real)0.5*x[SOLVER(HAT) + a];
    }
}

/* dq = h D_p between the state and the end that x says. */
INLINE void SOLVER(position_increment)(const SOLVER(t) *w, lanes *x)
{
    lanes q_mean[N], p_mean[N], rate[N];
    SOLVER(mean_values)(w, x, q_mean, p_mean);
    lanes_mean_velocity(&w->constants, q_mean, p_mean, x, x + SOLVER(HAT), rate);
    for (int a = 0; a < N; ++a)
        x[a] = w->h*rate[a];
}

/* The momentum's increment a; the squares of what a sweep has changed are added up. */
INLINE void SOLVER(accumulate_increment)(const SOLVER(t) *w, int a, lanes force, lanes *x, lanes *q_change,
    lanes *p_change)
{
    x[SOLVER(HAT) + a] = force;
    const lanes dq = x[a] - w->now.x[a], dp = force - w->now.x[SOLVER(HAT) + a];
    *q_change += dq*dq;
    *p_change += dp*dp;
}

/* D_q - F there, with F at the means and the middle of the step. */
INLINE void SOLVER(evaluate_mean_force)(const SOLVER(t) *w, const lanes *x, lanes *rate)
{
    lanes q_mean[N], p_mean[N];
    const lanes t = w->t + (real)0.5*w->h;
    SOLVER(mean_values)(w, x, q_mean, p_mean);
    lanes_mean_force(&w->constants, q_mean, p_mean, x, x + SOLVER(HAT), &t, rate);
}

#if !GS_CONSTRAINED
/* Without constraints there is nothing to begin with, to correct, or to look at. */
INLINE void SOLVER(begin_iteration)(SOLVER(t) *w)
{
    (void)w;
}

INLINE void SOLVER(factorise_schur)(SOLVER(t) *w)
{
    (void)w;
}

INLINE void SOLVER(evaluate_constraints)(SOLVER(t) *w)
{
    w->constraint_state.defect = splat(0);
}

static void SOLVER(prepare_schur)(SOLVER(t) *w)
{
    (void)w;
}

static void SOLVER(multipliers)(const SOLVER(t) *w, int lane, real *multipliers)
{
    (void)w, (void)lane, (void)multipliers;
}

/* The second half of a sweep: dp from dq. */
INLINE void SOLVER(update_rates)(SOLVER(t) *w, lanes *x, lanes *q_change, lanes *p_change)
{
    lanes rate[N];
    SOLVER(evaluate_mean_force)(w, x, rate);
    for (int a = 0; a < N; ++a)
        SOLVER(accumulate_increment)(w, a, -w->h*rate[a], x, q_change, p_change);
}
#endif

#if GS_CONSTRAINED
#if GS_ELEMENTS
/* g at the state, with what rounding left of q, and 1/|G_mu|^2 of each row of G. */
INLINE void SOLVER(evaluate_constraints)(SOLVER(t) *w)
{
    SOLVER(constraint_state) *at = &w->constraint_state;
    lanes_constraint(&w->constants, w->q, at->g_rounded);
    lanes_constraint_change(&w->constants, w->q, w->q_low, at->g, at->row_weight);
    for (int mu = 0; mu < M; ++mu) {
        at->g[mu] += at->g_rounded[mu];
        at->row_weight[mu] = 1/at->row_weight[mu];
    }
}
#else
/* g at the state, with what rounding left of q, and 1/|G_mu|^2 of each row of G. */
INLINE void SOLVER(evaluate_constraints)(SOLVER(t) *w)
{
    lanes G[M][N];
    lanes_constraint(&w->constants, w->q, w->constraint_state.g_rounded);
    lanes_constraint_jacobian(&w->constants, w->q, G);
    for (int mu = 0; mu < M; ++mu) {
        lanes square = splat(LIMIT(MIN));
        w->constraint_state.g[mu] = w->constraint_state.g_rounded[mu];
        for (int a = 0; a < N; ++a) {
            w->constraint_state.g[mu] += G[mu][a]*w->q_low[a];
            square += G[mu][a]*G[mu][a];
        }
        w->constraint_state.row_weight[mu] = 1/square;
    }
}
#endif

#if GS_CONSTANT_SCHUR
/* W is constant where g = 0: there is nothing to factorise, and its inverse multiplies. */
INLINE void SOLVER(factorise_schur)(SOLVER(t) *w)
{
    (void)w;
}

/* impulse += 2 (h W)^-1 g */
INLINE void SOLVER(apply_schur_inverse)(const SOLVER(t) *w, lanes g[M], lanes *impulse)
{
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            impulse[mu] += 2*w->constraint_state.W_inverse[mu][nu]*g[nu];
}

#if GS_SCALAR_SCHUR
/* (h W)^-1 of the run, and c with H_pp G^T = c G^T */
static void SOLVER(prepare_schur)(SOLVER(t) *w)
{
    lanes_schur_inverse(&w->constants, w->constraint_state.W_inverse);
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            w->constraint_state.W_inverse[mu][nu] *= w->h_inverse;
    w->constraint_state.correction = lanes_correction(&w->constants);
}
#else
/* (h W)^-1 of the run */
static void SOLVER(prepare_schur)(SOLVER(t) *w)
{
    lanes_schur_inverse(&w->constants, w->constraint_state.W_inverse);
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            w->constraint_state.W_inverse[mu][nu] *= w->h_inverse;
}
#endif
#else
/* W = G H_pp G^T at the end of the step, factorised */
INLINE void SOLVER(factorise_schur)(SOLVER(t) *w)
{
    lanes q[N], p[N];
    for (int a = 0; a < N; ++a) {
        q[a] = w->q[a] + w->now.x[a];
        p[a] = w->p[a] + w->now.x[SOLVER(HAT) + a];
    }
    lanes_schur(LANES_AT(&w->constants, w->t + w->step), q, p, w->now.factor);
    lanes_factor(w->now.factor);
}

/* impulse += 2 (h W)^-1 g */
INLINE void SOLVER(apply_schur_inverse)(SOLVER(t) *w, lanes g[M], lanes *impulse)
{
    lanes_substitute(w->now.factor, g);
    for (int mu = 0; mu < M; ++mu)
        impulse[mu] += 2*w->h_inverse*g[mu];
}

static void SOLVER(prepare_schur)(SOLVER(t) *w)
{
    (void)w;
}
#endif

#if GS_SCALAR_SCHUR
/* H_pp G^T = c G^T: a pull changes the velocity by c times what it changes the momenta by. */
INLINE void SOLVER(add_multiplier_response)(const SOLVER(t) *w, int a, lanes force, lanes *x)
{
    x[a] -= (real)0.5*w->h*w->constraint_state.correction*force;
}

INLINE void SOLVER(update_position_increment)(const SOLVER(t) *w, lanes *x)
{
    (void)w, (void)x;
}
#else
/* What the pulls change of the velocity is found by another look at it. */
INLINE void SOLVER(add_multiplier_response)(const SOLVER(t) *w, int a, lanes force, lanes *x)
{
    (void)w, (void)a, (void)force, (void)x;
}

INLINE void SOLVER(update_position_increment)(const SOLVER(t) *w, lanes *x)
{
    SOLVER(position_increment)(w, x);
}
#endif

INLINE void SOLVER(begin_iteration)(SOLVER(t) *w)
{
    SOLVER(factorise_schur)(w);
}

/*
 * Corrects the impulses, so that the end is on the constraints; w->bound.defect is how far from
 * g = 0 it was before.
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

/* The multipliers of lane i, from its impulses. */
static void SOLVER(multipliers)(const SOLVER(t) *w, int lane, real *multipliers)
{
    for (int mu = 0; mu < M; ++mu)
        multipliers[mu] = lane_get(&w->now.x[SOLVER(IMPULSE) + mu], lane)/lane_get(&w->h, lane);
}

#if GS_ELEMENTS
/* The second half of a sweep: the impulses, both increments corrected, dp from them. */
INLINE void SOLVER(update_rates)(SOLVER(t) *w, lanes *x, lanes *q_change, lanes *p_change)
{
    lanes correction[M], force[N], at[N], q_mean[N], p_mean[N], rate[N];
    SOLVER(mean_values)(w, x, q_mean, p_mean);
    SOLVER(correct_multipliers)(w, x);
    for (int mu = 0; mu < M; ++mu)
        correction[mu] = x[SOLVER(IMPULSE) + mu] - w->now.x[SOLVER(IMPULSE) + mu];
    lanes_mean_pull(&w->constants, q_mean, x, correction, force);
    for (int a = 0; a < N; ++a)
        x[SOLVER(HAT) + a] -= force[a];
    SOLVER(update_position_increment)(w, x);
    SOLVER(evaluate_mean_force)(w, x, rate);
    SOLVER(mean_values)(w, x, at, p_mean);
    lanes_mean_pull(&w->constants, at, x, x + SOLVER(IMPULSE), force);
    for (int a = 0; a < N; ++a)
        SOLVER(accumulate_increment)(w, a, -w->h*rate[a] - force[a], x, q_change, p_change);
}
#else
/* The second half of a sweep: the impulses, both increments corrected, dp from them. */
INLINE void SOLVER(update_rates)(SOLVER(t) *w, lanes *x, lanes *q_change, lanes *p_change)
{
    lanes G[M][N], q_mean[N], p_mean[N], rate[N];
    SOLVER(mean_values)(w, x, q_mean, p_mean);
    lanes_mean_constraint(&w->constants, q_mean, x, G);
    SOLVER(correct_multipliers)(w, x);
    for (int mu = 0; mu < M; ++mu)
        for (int a = 0; a < N; ++a) {
            const int e = SOLVER(IMPULSE) + mu;
            const lanes reaction = G[mu][a]*(x[e] - w->now.x[e]);
            x[SOLVER(HAT) + a] -= reaction;
            SOLVER(add_multiplier_response)(w, a, reaction, x);
        }
    SOLVER(update_position_increment)(w, x);
    SOLVER(evaluate_mean_force)(w, x, rate);
    for (int a = 0; a < N; ++a) {
        lanes force = -w->h*rate[a];
        for (int mu = 0; mu < M; ++mu)
            force -= G[mu][a]*x[SOLVER(IMPULSE) + mu];
        SOLVER(accumulate_increment)(w, a, force, x, q_change, p_change);
    }
}
#endif
#endif

#if GS_TIME_DEPENDENT
#if GS_CONSTRAINED
/* lambda.g_t: the power of a drive through the constraints, g_t between the two ends */
INLINE lanes SOLVER(constraint_power)(const SOLVER(t) *w, const lanes *q_mean)
{
    lanes rate[M], sum = splat(0);
    lanes_mean_constraint_rate(&w->constants, q_mean, w->now.x, rate);
    for (int mu = 0; mu < M; ++mu)
        sum += w->h_inverse*w->now.x[SOLVER(IMPULSE) + mu]*rate[mu];
    return sum;
}
#else
/* There is no constraint that a drive could move. */
INLINE lanes SOLVER(constraint_power)(const SOLVER(t) *w, const lanes *q_mean)
{
    (void)w, (void)q_mean;
    return splat(0);
}
#endif
#endif

#if GS_FORCES
#if GS_ENERGY_MOMENTUM
/* Adds F.dq, the work of the forces at the mean velocity dq/h. It is what H gains, exactly. */
INLINE void SOLVER(add_work)(SOLVER(t) *w)
{
    lanes q_mean[N], p_mean[N], v[N], F[N], done = splat(0), total;
    const lanes t = w->t + (real)0.5*w->h;
    SOLVER(mean_values)(w, w->now.x, q_mean, p_mean);
    for (int a = 0; a < N; ++a)
        v[a] = w->h_inverse*w->now.x[a];
    lanes_force_of_velocity(LANES_BETWEEN(&w->constants, w->t, w->step), q_mean, v, &t, F);
    for (int a = 0; a < N; ++a)
        done += F[a]*w->now.x[a];
    IF_TIME(done += w->step*lanes_mean_energy_rate(&w->constants, q_mean, p_mean, w->now.x,
        w->now.x + SOLVER(HAT));)
    IF_TIME(done += w->step*SOLVER(constraint_power)(w, q_mean);)
    two_sum(w->work, done + w->work_low, &total, &w->work_low);
    w->work = total;
}
#else
/* Adds F.dq, the work of the forces. For a discrete gradient it is what H gains, exactly. */
INLINE void SOLVER(add_work)(SOLVER(t) *w)
{
    lanes q_mean[N], p_mean[N], F[N], done = splat(0), total;
    IF_FRAME_WORK(lanes v[N];)
    const lanes t = w->t + (real)0.5*w->h;
    SOLVER(mean_values)(w, w->now.x, q_mean, p_mean);
    lanes_applied_force(LANES_BETWEEN(&w->constants, w->t, w->step), q_mean, p_mean, &t, F);
    for (int a = 0; a < N; ++a)
        done += F[a]*w->now.x[a];
    IF_FRAME_WORK(lanes_frame_velocity(&w->constants, q_mean, v);)
    IF_FRAME_WORK(for (int a = 0; a < N; ++a))
        IF_FRAME_WORK(done += w->h*F[a]*v[a];)
    IF_TIME(done += w->step*lanes_mean_energy_rate(&w->constants, q_mean, p_mean, w->now.x,
        w->now.x + SOLVER(HAT));)
    IF_TIME(done += w->step*SOLVER(constraint_power)(w, q_mean);)
    two_sum(w->work, done + w->work_low, &total, &w->work_low);
    w->work = total;
}
#endif
#else
/* Without forces no work is done. */
INLINE void SOLVER(add_work)(SOLVER(t) *w)
{
    (void)w;
}
#endif

#if GS_FRAME
#include "gyrospark/frames/relative_equilibrium.h"
#endif

/* Starting values without a past: an explicit Euler step, no impulse. */
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
 * One sweep, Gauss-Seidel: dq from dp, the impulses from the constraint at the end, both corrected,
 * dp from them. w->change is the sum of squares of what it changed, relative to the state.
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

/*
 * What rounding is worth in a sweep, w->noise: the squared difference, relative to the state, that
 * it makes to the rates when a state is moved by two units in the last place, the mean of four
 * times, and what rounding the rates makes. The state is that at the start of the step, for sweeps
 * that have gone astray prove nothing.
 */
NOINLINE void SOLVER(estimate_round_off)(SOLVER(t) *w)
{
    lanes zero[N], H_p[N], H_q[N], dq = splat(0), dp = splat(0);
    unsigned chance = 1;
    const lanes t = w->t + (real)0.5*w->h;
    for (int a = 0; a < N; ++a)
        zero[a] = splat(0);
    lanes_mean_velocity(LANES_AT(&w->constants, t), w->q, w->p, zero, zero, H_p);
    lanes_mean_force(&w->constants, w->q, w->p, zero, zero, &t, H_q);
    for (int attempt = 0; attempt < 4; ++attempt) {
        lanes place[N], momentum[N], H_p_near[N], H_q_near[N];
        for (int a = 0; a < N; ++a) {
            place[a] = w->q[a] + perturbation(&chance)*w->q[a];
            momentum[a] = w->p[a] + perturbation(&chance)*w->p[a];
        }
        lanes_mean_velocity(&w->constants, place, momentum, zero, zero, H_p_near);
        lanes_mean_force(&w->constants, place, momentum, zero, zero, &t, H_q_near);
        for (int a = 0; a < N; ++a) {
            const lanes by_p = H_p_near[a] - H_p[a] + perturbation(&chance)*H_p[a];
            const lanes by_q = H_q_near[a] - H_q[a] + perturbation(&chance)*H_q[a];
            dq += by_p*by_p;
            dp += by_q*by_q;
        }
    }
    w->round_off = (real)0.25*w->h*w->h*(w->q_weight*dq + w->p_weight*dp);
}

/* The end of the step, in compensated sums. */
INLINE void SOLVER(finish)(SOLVER(t) *w)
{
    IF_FRAME(const SOLVER(state) before = SOLVER(current_state)(w);)
    lanes q[N], p[N];
    SOLVER(add_work)(w);
    for (int a = 0; a < N; ++a) {
        two_sum(w->q[a], w->now.x[a] + w->q_low[a], &q[a], &w->q_low[a]);
        two_sum(w->p[a], w->now.x[SOLVER(HAT) + a] + w->p_low[a], &p[a], &w->p_low[a]);
        w->q[a] = q[a];
        w->p[a] = p[a];
    }
    IF_TIME(lanes_at_time(&w->constants, w->t + w->step);)
    IF_FRAME(SOLVER(hold_equilibrium)(w, &before);)
    SOLVER(evaluate_constraints)(w);
}

/* Lane i of a run: its constants and time step. */
static void SOLVER(prepare)(SOLVER(t) *w, int lane, const constants *c, real h)
{
    set_constants(&w->constants, lane, c);
    lane_set(&w->h, lane, h);
    lane_set(&w->h_inverse, lane, 1/h);
}

/* What is known of the past. */
static void SOLVER(reset_history)(SOLVER(t) *w)
{
    reset_predictor(&w->predictor);
}

/* What follows from the constants and steps of all lanes. */
static void SOLVER(initialise)(SOLVER(t) *w)
{
    SOLVER(prepare_schur)(w);
    IF_FRAME(SOLVER(release_equilibrium)(w);)
    SOLVER(reset_history)(w);
    for (int a = 0; a < N; ++a)
        w->q_low[a] = w->p_low[a] = splat(0);
    w->work = w->work_low = splat(0);
    IF_TIME(lanes_at_time(&w->constants, w->t);)
    SOLVER(evaluate_constraints)(w);
}

/* What changes are relative to: the state and the step's own length. */
INLINE void SOLVER(update_scales)(SOLVER(t) *w)
{
    lanes q_square = splat(LIMIT(MIN)), p_square = splat(LIMIT(MIN));
    lanes q_increment = splat(0), p_increment = splat(0);
    for (int a = 0; a < N; ++a) {
        const lanes *dq = w->now.x, *dp = w->now.x + SOLVER(HAT);
        q_increment += dq[a]*dq[a];
        p_increment += dp[a]*dp[a];
        q_square += w->q[a]*w->q[a];
        p_square += w->p[a]*w->p[a];
    }
    w->q_weight = 1/(q_square + q_increment);
    w->p_weight = 1/(p_square + p_increment);
    w->step_squared = q_increment*w->q_weight + p_increment*w->p_weight;
}

/* Starting values of the next step. */
NOINLINE void SOLVER(start_iteration)(SOLVER(t) *w, int predicted)
{
    if (predicted) {
        const lanes *x = history_entry(&w->predictor, w->history, SOLVER(X), 0);
        for (int e = 0; e < SOLVER(X) && !w->predictor.fitted; ++e)
            w->extrapolated[e] = x[e];
        predict(&w->predictor, w->history, SOLVER(X), SOLVER(group_ends), w->extrapolated, w->now.x);
    } else
        SOLVER(euler_start)(w);
    SOLVER(update_scales)(w);
    SOLVER(begin_iteration)(w);
}

/* Records the step just done. */
INLINE void SOLVER(record_step)(SOLVER(t) *w)
{
    record_values(&w->predictor, w->history, SOLVER(X), SOLVER(group_ends), SOLVER(group_rows), w->extrapolated, w->now.x);
}

/* The unknowns from those of the sweeps, and those of a lane from them. */
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
