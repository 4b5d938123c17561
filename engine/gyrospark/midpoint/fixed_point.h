/* IMS and EMS: the fixed-point iteration. */
#ifndef GS_MIDPOINT_FIXED_POINT_H
#define GS_MIDPOINT_FIXED_POINT_H

#include "gyrospark/predictor/recurrence.h"

#if GS_FACTORS
#include "gyrospark/simd/small_lu.h"
#endif

#define SOLVER(f) SINGLE(f)

/* ---------------------------------------------------------------- sweeps: one mean value a step */

/* Where the unknowns stand: the increments dq and dp, and the impulses h lambda. */
enum { SOLVER(S) = 1, SOLVER(P) = 1 };
enum { SOLVER(HAT) = N, SOLVER(IMPULSE) = 2*N, SOLVER(X) = 2*N + M, SOLVER(RESULT) = SOLVER(X) };
static const int SOLVER(ends)[GROUPS] = { SOLVER(HAT), SOLVER(IMPULSE), SOLVER(X) };
static const int SOLVER(rows)[GROUPS] = { N, N, M };

#if !GS_CONSTRAINED
/* What a sweep improves. */
typedef struct {
    lanes x[SOLVER(X)];
} SOLVER(iterate);

/* There are no constraints. */
typedef struct {
    lanes defect; /* none */
} SOLVER(bound);
#endif

#if GS_CONSTRAINED
#if GS_CONSTANT_SCHUR
/* What a sweep improves: W is constant. */
typedef struct {
    lanes x[SOLVER(X)];
} SOLVER(iterate);

/* What is known of the constraints. */
typedef struct {
    lanes defect;       /* of the constraints in the last sweep */
    lanes shortness[M]; /* 1/|G_mu|^2 of the rows of G at the state */
    lanes g[M], g_rounded[M]; /* g at the state, with and without what rounding left over */
    lanes W_inverse[M][M]; /* by h */
    lanes correction;      /* c, with H_pp G^T = c G^T */
} SOLVER(bound);
#else
/* What a sweep improves, and the factors of W at the end of the step. */
typedef struct {
    lanes x[SOLVER(X)];
    schur_t factor;
} SOLVER(iterate);

/* What is known of the constraints. */
typedef struct {
    lanes defect;       /* of the constraints in the last sweep */
    lanes shortness[M]; /* 1/|G_mu|^2 of the rows of G at the state */
    lanes g[M], g_rounded[M]; /* g at the state, with and without what rounding left over */
} SOLVER(bound);
#endif
#endif

typedef struct {
    lanes_constants constants;
    lanes h, h_inverse;
    lanes q[N], p[N];         /* the state, rounded, */
    lanes q_low[N], p_low[N]; /* and what rounding left over */
    lanes q_size, p_size;     /* 1/(|q|^2 + |dq|^2), and of p: what changes are relative to */
    lanes moved;              /* |dq|^2 and |dp|^2 relative to these */
    lanes t;                  /* at the start of the step */
    IF_TIME(lanes span;)
    lanes work, work_low;     /* done by the forces since the start */
    lanes change, noise;      /* of the last sweep; what rounding is worth in one */
    IF_FRAME(int still[LANES];)
    SOLVER(iterate) now;
    SOLVER(bound) bound;
    predictor_t predictor;
    lanes through[SOLVER(X)]; /* what went before, once more */
    lanes past[HISTORY*SOLVER(X)];
} SOLVER(t);

/* The means of the ends (51). */
INLINE void SOLVER(means)(const SOLVER(t) *w, const lanes *x, lanes *q_mean, lanes *p_mean)
{
    for (int a = 0; a < N; ++a) {
        q_mean[a] = w->q[a] + (real)0.5*x[a];
        p_mean[a] = w->p[a] + (real)0.5*x[SOLVER(HAT) + a];
    }
}

/* dq = h D_p between the state and the end that x says. */
INLINE void SOLVER(move)(const SOLVER(t) *w, lanes *x)
{
    lanes q_mean[N], p_mean[N], rate[N];
    SOLVER(means)(w, x, q_mean, p_mean);
    lanes_mean_velocity(&w->constants, q_mean, p_mean, x, x + SOLVER(HAT), rate);
    for (int a = 0; a < N; ++a)
        x[a] = w->h*rate[a];
}

/* The momentum's increment a; the squares of what a sweep has changed are added up. */
INLINE void SOLVER(take)(const SOLVER(t) *w, int a, lanes force, lanes *x, lanes *q_change,
    lanes *p_change)
{
    x[SOLVER(HAT) + a] = force;
    const lanes dq = x[a] - w->now.x[a], dp = force - w->now.x[SOLVER(HAT) + a];
    *q_change += dq*dq;
    *p_change += dp*dp;
}

/* D_q - F there, with F at the means and the middle of the step. */
INLINE void SOLVER(kick)(const SOLVER(t) *w, const lanes *x, lanes *rate)
{
    lanes q_mean[N], p_mean[N];
    const lanes t = w->t + (real)0.5*w->h;
    SOLVER(means)(w, x, q_mean, p_mean);
    lanes_mean_force(&w->constants, q_mean, p_mean, x, x + SOLVER(HAT), &t, rate);
}

#if !GS_CONSTRAINED
/* Without constraints there is nothing to begin with, to correct, or to look at. */
INLINE void SOLVER(begin)(SOLVER(t) *w)
{
    (void)w;
}

INLINE void SOLVER(factor)(SOLVER(t) *w)
{
    (void)w;
}

INLINE void SOLVER(look)(SOLVER(t) *w)
{
    w->bound.defect = splat(0);
}

static void SOLVER(set_schur)(SOLVER(t) *w)
{
    (void)w;
}

static void SOLVER(multipliers)(const SOLVER(t) *w, int lane, real *multipliers)
{
    (void)w, (void)lane, (void)multipliers;
}

/* The second half of a sweep: dp from dq. */
INLINE void SOLVER(follow)(SOLVER(t) *w, lanes *x, lanes *q_change, lanes *p_change)
{
    lanes rate[N];
    SOLVER(kick)(w, x, rate);
    for (int a = 0; a < N; ++a)
        SOLVER(take)(w, a, -w->h*rate[a], x, q_change, p_change);
}
#endif

#if GS_CONSTRAINED
#if GS_ELEMENTS
/* g at the state, with what rounding left of q, and 1/|G_mu|^2 of each row of G. */
INLINE void SOLVER(look)(SOLVER(t) *w)
{
    SOLVER(bound) *at = &w->bound;
    lanes_constraint(&w->constants, w->q, at->g_rounded);
    lanes_constraint_change(&w->constants, w->q, w->q_low, at->g, at->shortness);
    for (int mu = 0; mu < M; ++mu) {
        at->g[mu] += at->g_rounded[mu];
        at->shortness[mu] = 1/at->shortness[mu];
    }
}
#else
/* g at the state, with what rounding left of q, and 1/|G_mu|^2 of each row of G. */
INLINE void SOLVER(look)(SOLVER(t) *w)
{
    lanes G[M][N];
    lanes_constraint(&w->constants, w->q, w->bound.g_rounded);
    lanes_constraint_jacobian(&w->constants, w->q, G);
    for (int mu = 0; mu < M; ++mu) {
        lanes square = splat(LIMIT(MIN));
        w->bound.g[mu] = w->bound.g_rounded[mu];
        for (int a = 0; a < N; ++a) {
            w->bound.g[mu] += G[mu][a]*w->q_low[a];
            square += G[mu][a]*G[mu][a];
        }
        w->bound.shortness[mu] = 1/square;
    }
}
#endif

#if GS_CONSTANT_SCHUR
/* W is constant where g = 0: there is nothing to factorise, and its inverse multiplies. */
INLINE void SOLVER(factor)(SOLVER(t) *w)
{
    (void)w;
}

/* impulse += 2 (h W)^-1 g */
INLINE void SOLVER(correct)(const SOLVER(t) *w, lanes g[M], lanes *impulse)
{
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            impulse[mu] += 2*w->bound.W_inverse[mu][nu]*g[nu];
}

#if GS_SCALAR_SCHUR
/* (h W)^-1 of the run, and c with H_pp G^T = c G^T */
static void SOLVER(set_schur)(SOLVER(t) *w)
{
    lanes_schur_inverse(&w->constants, w->bound.W_inverse);
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            w->bound.W_inverse[mu][nu] *= w->h_inverse;
    w->bound.correction = lanes_correction(&w->constants);
}
#else
/* (h W)^-1 of the run */
static void SOLVER(set_schur)(SOLVER(t) *w)
{
    lanes_schur_inverse(&w->constants, w->bound.W_inverse);
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            w->bound.W_inverse[mu][nu] *= w->h_inverse;
}
#endif
#else
/* W = G H_pp G^T at the end of the step, factorised */
INLINE void SOLVER(factor)(SOLVER(t) *w)
{
    lanes q[N], p[N];
    for (int a = 0; a < N; ++a) {
        q[a] = w->q[a] + w->now.x[a];
        p[a] = w->p[a] + w->now.x[SOLVER(HAT) + a];
    }
    lanes_schur(LANES_AT(&w->constants, w->t + w->span), q, p, w->now.factor);
    lanes_factor(w->now.factor);
}

/* impulse += 2 (h W)^-1 g */
INLINE void SOLVER(correct)(SOLVER(t) *w, lanes g[M], lanes *impulse)
{
    lanes_substitute(w->now.factor, g);
    for (int mu = 0; mu < M; ++mu)
        impulse[mu] += 2*w->h_inverse*g[mu];
}

static void SOLVER(set_schur)(SOLVER(t) *w)
{
    (void)w;
}
#endif

#if GS_SCALAR_SCHUR
/* H_pp G^T = c G^T: a pull changes the velocity by c times what it changes the momenta by. */
INLINE void SOLVER(respond)(const SOLVER(t) *w, int a, lanes pull, lanes *x)
{
    x[a] -= (real)0.5*w->h*w->bound.correction*pull;
}

INLINE void SOLVER(move_again)(const SOLVER(t) *w, lanes *x)
{
    (void)w, (void)x;
}
#else
/* What the pulls change of the velocity is found by another look at it. */
INLINE void SOLVER(respond)(const SOLVER(t) *w, int a, lanes pull, lanes *x)
{
    (void)w, (void)a, (void)pull, (void)x;
}

INLINE void SOLVER(move_again)(const SOLVER(t) *w, lanes *x)
{
    SOLVER(move)(w, x);
}
#endif

INLINE void SOLVER(begin)(SOLVER(t) *w)
{
    SOLVER(factor)(w);
}

/*
 * Corrects the impulses, so that the end is on the constraints; w->bound.defect is how far from
 * g = 0 it was before.
 */
INLINE void SOLVER(constrain)(SOLVER(t) *w, lanes *x)
{
    lanes g[M];
    lanes_constraint_increment(&w->constants, w->q, x, g);
    w->bound.defect = splat(0);
    for (int mu = 0; mu < M; ++mu) {
        g[mu] += w->bound.g[mu];
        w->bound.defect += g[mu]*g[mu]*w->bound.shortness[mu];
    }
    w->bound.defect *= w->q_size;
    SOLVER(correct)(w, g, x + SOLVER(IMPULSE));
}

/* The multipliers of lane i, from its impulses. */
static void SOLVER(multipliers)(const SOLVER(t) *w, int lane, real *multipliers)
{
    for (int mu = 0; mu < M; ++mu)
        multipliers[mu] = part(&w->now.x[SOLVER(IMPULSE) + mu], lane)/part(&w->h, lane);
}

#if GS_ELEMENTS
/* The second half of a sweep: the impulses, both increments corrected, dp from them. */
INLINE void SOLVER(follow)(SOLVER(t) *w, lanes *x, lanes *q_change, lanes *p_change)
{
    lanes more[M], pull[N], at[N], q_mean[N], p_mean[N], rate[N];
    SOLVER(means)(w, x, q_mean, p_mean);
    SOLVER(constrain)(w, x);
    for (int mu = 0; mu < M; ++mu)
        more[mu] = x[SOLVER(IMPULSE) + mu] - w->now.x[SOLVER(IMPULSE) + mu];
    lanes_mean_pull(&w->constants, q_mean, x, more, pull);
    for (int a = 0; a < N; ++a)
        x[SOLVER(HAT) + a] -= pull[a];
    SOLVER(move_again)(w, x);
    SOLVER(kick)(w, x, rate);
    SOLVER(means)(w, x, at, p_mean);
    lanes_mean_pull(&w->constants, at, x, x + SOLVER(IMPULSE), pull);
    for (int a = 0; a < N; ++a)
        SOLVER(take)(w, a, -w->h*rate[a] - pull[a], x, q_change, p_change);
}
#else
/* The second half of a sweep: the impulses, both increments corrected, dp from them. */
INLINE void SOLVER(follow)(SOLVER(t) *w, lanes *x, lanes *q_change, lanes *p_change)
{
    lanes G[M][N], q_mean[N], p_mean[N], rate[N];
    SOLVER(means)(w, x, q_mean, p_mean);
    lanes_mean_constraint(&w->constants, q_mean, x, G);
    SOLVER(constrain)(w, x);
    for (int mu = 0; mu < M; ++mu)
        for (int a = 0; a < N; ++a) {
            const int e = SOLVER(IMPULSE) + mu;
            const lanes pull = G[mu][a]*(x[e] - w->now.x[e]);
            x[SOLVER(HAT) + a] -= pull;
            SOLVER(respond)(w, a, pull, x);
        }
    SOLVER(move_again)(w, x);
    SOLVER(kick)(w, x, rate);
    for (int a = 0; a < N; ++a) {
        lanes force = -w->h*rate[a];
        for (int mu = 0; mu < M; ++mu)
            force -= G[mu][a]*x[SOLVER(IMPULSE) + mu];
        SOLVER(take)(w, a, force, x, q_change, p_change);
    }
}
#endif
#endif

#if GS_TIME_DEPENDENT
#if GS_CONSTRAINED
/* lambda.g_t: the power of a drive through the constraints, g_t between the two ends */
INLINE lanes SOLVER(drive_of_constraints)(const SOLVER(t) *w, const lanes *q_mean)
{
    lanes rate[M], sum = splat(0);
    lanes_mean_constraint_rate(&w->constants, q_mean, w->now.x, rate);
    for (int mu = 0; mu < M; ++mu)
        sum += w->h_inverse*w->now.x[SOLVER(IMPULSE) + mu]*rate[mu];
    return sum;
}
#else
/* There is no constraint that a drive could move. */
INLINE lanes SOLVER(drive_of_constraints)(const SOLVER(t) *w, const lanes *q_mean)
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
    SOLVER(means)(w, w->now.x, q_mean, p_mean);
    for (int a = 0; a < N; ++a)
        v[a] = w->h_inverse*w->now.x[a];
    lanes_force_of_velocity(LANES_BETWEEN(&w->constants, w->t, w->span), q_mean, v, &t, F);
    for (int a = 0; a < N; ++a)
        done += F[a]*w->now.x[a];
    IF_TIME(done += w->span*lanes_mean_drive(&w->constants, q_mean, p_mean, w->now.x,
        w->now.x + SOLVER(HAT));)
    IF_TIME(done += w->span*SOLVER(drive_of_constraints)(w, q_mean);)
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
    SOLVER(means)(w, w->now.x, q_mean, p_mean);
    lanes_applied_force(LANES_BETWEEN(&w->constants, w->t, w->span), q_mean, p_mean, &t, F);
    for (int a = 0; a < N; ++a)
        done += F[a]*w->now.x[a];
    IF_FRAME_WORK(lanes_carried(&w->constants, q_mean, v);)
    IF_FRAME_WORK(for (int a = 0; a < N; ++a))
        IF_FRAME_WORK(done += w->h*F[a]*v[a];)
    IF_TIME(done += w->span*lanes_mean_drive(&w->constants, q_mean, p_mean, w->now.x,
        w->now.x + SOLVER(HAT));)
    IF_TIME(done += w->span*SOLVER(drive_of_constraints)(w, q_mean);)
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
INLINE void SOLVER(guess)(SOLVER(t) *w)
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
INLINE void SOLVER(sweep)(SOLVER(t) *w)
{
    lanes x[SOLVER(X)], q_change = splat(0), p_change = splat(0);
    for (int e = 0; e < SOLVER(X); ++e)
        x[e] = w->now.x[e];
    IF_TIME(lanes_between(&w->constants, w->t, w->span);)
    SOLVER(move)(w, x);
    SOLVER(follow)(w, x, &q_change, &p_change);
    for (int e = 0; e < SOLVER(X); ++e)
        w->now.x[e] = x[e];
    w->change = q_change*w->q_size + p_change*w->p_size;
}

/*
 * What rounding is worth in a sweep, w->noise: the squared difference, relative to the state, that
 * it makes to the rates when a state is moved by two units in the last place, the mean of four
 * times, and what rounding the rates makes. The state is that at the start of the step, for sweeps
 * that have gone astray prove nothing.
 */
NOINLINE void SOLVER(noise)(SOLVER(t) *w)
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
INLINE void SOLVER(finish)(SOLVER(t) *w)
{
    IF_FRAME(const SOLVER(place) before = SOLVER(here)(w);)
    lanes q[N], p[N];
    SOLVER(add_work)(w);
    for (int a = 0; a < N; ++a) {
        two_sum(w->q[a], w->now.x[a] + w->q_low[a], &q[a], &w->q_low[a]);
        two_sum(w->p[a], w->now.x[SOLVER(HAT) + a] + w->p_low[a], &p[a], &w->p_low[a]);
        w->q[a] = q[a];
        w->p[a] = p[a];
    }
    IF_TIME(lanes_at_time(&w->constants, w->t + w->span);)
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

/* What is known of the past. */
static void SOLVER(forget)(SOLVER(t) *w)
{
    forget(&w->predictor);
}

/* What follows from the constants and steps of all lanes. */
static void SOLVER(set_up)(SOLVER(t) *w)
{
    SOLVER(set_schur)(w);
    IF_FRAME(SOLVER(wake)(w);)
    SOLVER(forget)(w);
    for (int a = 0; a < N; ++a)
        w->q_low[a] = w->p_low[a] = splat(0);
    w->work = w->work_low = splat(0);
    IF_TIME(lanes_at_time(&w->constants, w->t);)
    SOLVER(look)(w);
}

/* What changes are relative to: the state and the step's own length. */
INLINE void SOLVER(sizes)(SOLVER(t) *w)
{
    lanes q_square = splat(LIMIT(MIN)), p_square = splat(LIMIT(MIN));
    lanes q_way = splat(0), p_way = splat(0);
    for (int a = 0; a < N; ++a) {
        const lanes *dq = w->now.x, *dp = w->now.x + SOLVER(HAT);
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
    if (predicted) {
        const lanes *x = past_values(&w->predictor, w->past, SOLVER(X), 0);
        for (int e = 0; e < SOLVER(X) && !w->predictor.fitted; ++e)
            w->through[e] = x[e];
        predict(&w->predictor, w->past, SOLVER(X), SOLVER(ends), w->through, w->now.x);
    } else
        SOLVER(guess)(w);
    SOLVER(sizes)(w);
    SOLVER(begin)(w);
}

/* Records the step just done. */
INLINE void SOLVER(remember)(SOLVER(t) *w)
{
    record(&w->predictor, w->past, SOLVER(X), SOLVER(ends), SOLVER(rows), w->through, w->now.x);
}

/* The unknowns from those of the sweeps, and those of a lane from them. */
static void SOLVER(unscale)(const SOLVER(t) *w, real x[U])
{
    for (int e = 0; e < SOLVER(X); ++e)
        x[e] = part(&w->now.x[e], 0)/(e < SOLVER(IMPULSE) ? 1 : part(&w->h, 0));
}

static void SOLVER(load)(SOLVER(t) *w, int lane, const real x[U])
{
    for (int e = 0; e < SOLVER(X); ++e)
        set_part(&w->now.x[e], lane, x[e]*(e < SOLVER(IMPULSE) ? 1 : part(&w->h, lane)));
}

#undef SOLVER

#endif
