/* IMS and EMS (midpoint and energy-momentum scheme): the fixed-point iteration. */
#ifndef GS_MIDPOINT_FIXED_POINT_H
#define GS_MIDPOINT_FIXED_POINT_H

#include "gyrospark/predictor/recurrence.h"

#if GS_FACTORS
#include "gyrospark/simd/small_lu.h"
#endif

#define SOLVER(f) SINGLE(f)

/* Layout of the unknowns: the increments dq and dp, and the impulses h lambda. */
enum { SOLVER(S) = 1, SOLVER(P) = 1 };
enum { SOLVER(HAT) = N, SOLVER(IMPULSE) = 2*N, SOLVER(X) = 2*N + M, SOLVER(RESULT) = SOLVER(X) };
static const int SOLVER(group_ends)[GROUPS] = { SOLVER(HAT), SOLVER(IMPULSE), SOLVER(X) };
static const int SOLVER(group_rows)[GROUPS] = { MEASURED, MEASURED, M };

#if !GS_CONSTRAINED
/* Unknowns of the iteration. */
typedef struct {
    lanes x[SOLVER(X)];
} SOLVER(unknowns);

/* State of the constraints: there are none. */
typedef struct {
    lanes defect; /* 0 */
} SOLVER(constraint_state);
#endif

#if GS_CONSTRAINED
#if GS_CONSTANT_SCHUR
/* Unknowns of the iteration; W is constant. */
typedef struct {
    lanes x[SOLVER(X)];
} SOLVER(unknowns);

/* State of the constraints. */
typedef struct {
    lanes defect; /* squared constraint defect of the last iteration, relative to the state */
    lanes row_weight[M]; /* 1/|G_mu|^2, rows of G at the state */
    lanes g[M], g_rounded[M]; /* g at q + q_low, and at the rounded q */
    lanes W_inverse[M][M]; /* (h W)^-1 */
    lanes correction;      /* c in H_pp G^T = c G^T */
} SOLVER(constraint_state);
#else
/* Unknowns of the iteration, and the factors of W at the end of the step. */
typedef struct {
    lanes x[SOLVER(X)];
    schur_t factor;
} SOLVER(unknowns);

/* State of the constraints. */
typedef struct {
    lanes defect; /* squared constraint defect of the last iteration, relative to the state */
    lanes row_weight[M]; /* 1/|G_mu|^2, rows of G at the state */
    lanes g[M], g_rounded[M]; /* g at q + q_low, and at the rounded q */
} SOLVER(constraint_state);
#endif
#endif

typedef struct {
    lanes_constants constants;
    lanes h, h_inverse;
    lanes q[N], p[N];         /* the state, rounded */
    lanes q_low[N], p_low[N]; /* compensation of the sums: round-off of q and p */
    lanes q_weight, p_weight; /* 1/(|q|^2 + |dq|^2), and the same for p: scales of changes */
    lanes step_squared;       /* |dq|^2 q_weight + |dp|^2 p_weight */
    lanes t;                  /* time at the start of the step */
    IF_TIME(lanes step;)
    lanes work, work_low;     /* work of the forces since the start, and its round-off */
    lanes change, round_off;  /* of an iteration: squared change, estimated round-off */
    IF_FRAME(int stationary[LANES];)
    SOLVER(unknowns) now;
    SOLVER(constraint_state) constraint_state;
    predictor_t predictor;
    lanes extrapolated[SOLVER(X)]; /* the increments of the last step */
    lanes history[HISTORY*SOLVER(X)];
} SOLVER(t);

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
/* No constraints: nothing to factorise, to correct or to evaluate. */
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
#endif

#if GS_SCALAR_SCHUR
/* H_pp G^T = c G^T: a constraint force changes the velocity by c times the change of momentum. */
INLINE void SOLVER(add_multiplier_response)(const SOLVER(t) *w, int a, lanes force, lanes *x)
{
    x[a] -= (real)0.5*w->h*w->constraint_state.correction*force;
}

INLINE void SOLVER(update_position_increment)(const SOLVER(t) *w, lanes *x)
{
    (void)w, (void)x;
}
#else
/* H_pp G^T is not c G^T: update_position_increment evaluates the velocity again. */
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

#if GS_ELEMENTS
/* Corrects the impulses and both increments, then dp: Gauss-Seidel ordering. */
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
/* Corrects the impulses and both increments, then dp: Gauss-Seidel ordering. */
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
/* lambda.g_t: power of the rheonomic constraints, with the discrete derivative g_t of the step */
INLINE lanes SOLVER(constraint_power)(const SOLVER(t) *w, const lanes *q_mean)
{
    lanes rate[M], sum = splat(0);
    lanes_mean_constraint_rate(&w->constants, q_mean, w->now.x, rate);
    for (int mu = 0; mu < M; ++mu)
        sum += w->h_inverse*w->now.x[SOLVER(IMPULSE) + mu]*rate[mu];
    return sum;
}
#else
/* No constraints: no power of rheonomic constraints. */
INLINE lanes SOLVER(constraint_power)(const SOLVER(t) *w, const lanes *q_mean)
{
    (void)w, (void)q_mean;
    return splat(0);
}
#endif
#endif

#if GS_FORCES
#if GS_CLOCK
/* work -= dp of the time: work of the forces and of explicit time dependence */
INLINE void SOLVER(add_work)(SOLVER(t) *w)
{
    lanes total;
    two_sum(w->work, w->work_low - w->now.x[SOLVER(HAT) + N - 1], &total, &w->work_low);
    w->work = total;
}
#elif GS_ENERGY_MOMENTUM
/* work += F.dq with F at the mean velocity dq/h. H changes by exactly this work. */
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
/* work += F.dq. With a discrete gradient, H changes by exactly this work. */
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
/* No forces: no work. */
INLINE void SOLVER(add_work)(SOLVER(t) *w)
{
    (void)w;
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

/*
 * w->round_off: estimate of the round-off in one iteration, as a squared change relative to the
 * state. The rates are evaluated at four random perturbations of the state by 2 ulp and are
 * perturbed by 2 ulp themselves; the estimate is the mean squared difference. The state is the
 * start of the step, because the iterates may be far from the solution.
 */
NOINLINE void SOLVER(estimate_round_off)(SOLVER(t) *w)
{
    lanes zero[N], H_p[N], H_q[N], dq = splat(0), dp = splat(0);
    unsigned seed = 1;
    const lanes t = w->t + (real)0.5*w->h;
    for (int a = 0; a < N; ++a)
        zero[a] = splat(0);
    lanes_mean_velocity(LANES_AT(&w->constants, t), w->q, w->p, zero, zero, H_p);
    lanes_mean_force(&w->constants, w->q, w->p, zero, zero, &t, H_q);
    for (int sample = 0; sample < 4; ++sample) {
        lanes position[N], momentum[N], H_p_perturbed[N], H_q_perturbed[N];
        for (int a = 0; a < N; ++a) {
            position[a] = w->q[a] + perturbation(&seed)*w->q[a];
            momentum[a] = w->p[a] + perturbation(&seed)*w->p[a];
        }
        lanes_mean_velocity(&w->constants, position, momentum, zero, zero, H_p_perturbed);
        lanes_mean_force(&w->constants, position, momentum, zero, zero, &t, H_q_perturbed);
        for (int a = 0; a < MEASURED; ++a) {
            const lanes by_p = H_p_perturbed[a] - H_p[a] + perturbation(&seed)*H_p[a];
            const lanes by_q = H_q_perturbed[a] - H_q[a] + perturbation(&seed)*H_q[a];
            dq += by_p*by_p;
            dp += by_q*by_q;
        }
    }
    w->round_off = (real)0.25*w->h*w->h*(w->q_weight*dq + w->p_weight*dp);
}

/* The end of the step, by compensated summation. */
INLINE_IF_SMALL void SOLVER(finish)(SOLVER(t) *w)
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

#if GS_CLOCK
/* 1 if the time advances in the step of a lane. */
static int SOLVER(time_advances)(const SOLVER(t) *w, int lane)
{
    return lane_get(&w->now.x[N - 1], lane)*lane_get(&w->h, lane) > 0;
}
#endif

/* Sets the constants and the step size of a lane. */
static void SOLVER(prepare)(SOLVER(t) *w, int lane, const constants *c, real h)
{
    set_constants(&w->constants, lane, c);
    lane_set(&w->h, lane, h);
    lane_set(&w->h_inverse, lane, 1/h);
}

/* Clears the history. */
static void SOLVER(reset_history)(SOLVER(t) *w)
{
    reset_predictor(&w->predictor);
}

/* Computes all that depends on the constants and step sizes; clears history and work. */
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

/* The scales of changes: 1/(|q|^2 + |dq|^2), and the same for p. */
INLINE void SOLVER(update_scales)(SOLVER(t) *w)
{
    lanes q_square = splat(LIMIT(MIN)), p_square = splat(LIMIT(MIN));
    lanes q_increment = splat(0), p_increment = splat(0);
    for (int a = 0; a < MEASURED; ++a) {
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
    SOLVER(begin_iteration)(w);
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
