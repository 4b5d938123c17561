/* Profiles control and run: IMS and EMS by fixed-point iteration. */
#ifndef GS_PROFILES_MIDPOINT_H
#define GS_PROFILES_MIDPOINT_H

#include "gyrospark/profiles/arithmetic.h"

/* The unknowns x: the increments dq and dp of the step, and the impulses h lambda. */
enum { HAT = N, IMPULSE = 2*N, X = (2*N) + M };

/* Mean values of both ends of the step (51). */
static void means(const state_t *w, const real x[X], real q_mean[N], real p_mean[N])
{
    for (int a = 0; a < N; ++a) {
        q_mean[a] = w->q[a] + (real)0.5*x[a];
        p_mean[a] = w->p[a] + (real)0.5*x[HAT + a];
    }
}

/* x <- dq = h D_p between the state and the end given by x. */
static void position_increment(const state_t *w, real x[X])
{
    real q_mean[N];
    real p_mean[N];
    real rate[N];
    means(w, x, q_mean, p_mean);
    mean_velocity(&w->constants, q_mean, p_mean, x, &x[HAT], rate);
    for (int a = 0; a < N; ++a) {
        x[a] = w->h*rate[a];
    }
}

/* dp = -h (D_q - F) without constraint forces, F at the middle of the step */
static void momentum_increment(const state_t *w, const real x[X], real dp[N])
{
    real q_mean[N];
    real p_mean[N];
    real rate[N];
    const real t = w->t + (real)0.5*w->h;
    means(w, x, q_mean, p_mean);
    mean_force(&w->constants, q_mean, p_mean, x, &x[HAT], &t, rate);
    for (int a = 0; a < N; ++a) {
        dp[a] = -w->h*rate[a];
    }
}

/* Starting values without history: an explicit Euler step, zero impulses. */
static void initial_unknowns(state_t *w)
{
    real dp[N];
    for (int e = 0; e < X; ++e) {
        w->x[e] = 0;
    }
    momentum_increment(w, w->x, dp);
    position_increment(w, w->x);
    for (int a = 0; a < N; ++a) {
        w->x[HAT + a] = dp[a];
    }
}

#if GS_CONSTRAINED
#if GS_CONSTANT_SCHUR
/* W is constant where g = 0: its inverse is a constant of the run. */
static void begin_iteration(state_t *w)
{
    (void)w;
}

/* impulse += 2 (h W)^-1 g */
static void apply_schur_inverse(const state_t *w, const real g[M], real impulse[M])
{
    for (int mu = 0; mu < M; ++mu) {
        for (int nu = 0; nu < M; ++nu) {
            impulse[mu] += 2*w->h_inverse*w->constants.W_inverse[mu][nu]*g[nu];
        }
    }
}
#else
/* Factors of W = G H_pp G^T at the end of the step. */
static void begin_iteration(state_t *w)
{
    real q[N];
    real p[N];
    for (int a = 0; a < N; ++a) {
        q[a] = w->q[a] + w->x[a];
        p[a] = w->p[a] + w->x[HAT + a];
    }
    schur(&w->constants, q, p, w->factors[0]);
    factorise(w->factors[0]);
}

/* impulse += 2 (h W)^-1 g */
static void apply_schur_inverse(state_t *w, real g[M], real impulse[M])
{
    substitute(w->factors[0], g);
    for (int mu = 0; mu < M; ++mu) {
        impulse[mu] += 2*w->h_inverse*g[mu];
    }
}
#endif

/*
 * Corrects the impulses so that the end satisfies g = 0, and both increments with them. G is the
 * mean of dg/dq between both ends, w->defect the squared constraint error before the correction.
 */
static void correct_multipliers(state_t *w, real x[X], real G[ROOM][N])
{
    real q_mean[N];
    real p_mean[N];
    real g[M];
    real old[M];
    means(w, x, q_mean, p_mean);
    KERNEL(mean_constraint)(&w->constants, q_mean, x, G);
    KERNEL(constraint_increment)(&w->constants, w->q, x, g);
    w->defect = 0;
    for (int mu = 0; mu < M; ++mu) {
        g[mu] += w->g[mu];
        w->defect += g[mu]*g[mu]*w->row_weight[mu]*w->q_weight;
        old[mu] = x[IMPULSE + mu];
    }
    apply_schur_inverse(w, g, &x[IMPULSE]);
    for (int mu = 0; mu < M; ++mu) {
        for (int a = 0; a < N; ++a) {
            const real force = G[mu][a]*(x[IMPULSE + mu] - old[mu]);
            x[HAT + a] -= force;
#if GS_SCALAR_SCHUR /* H_pp G^T = c G^T: it changes dq by h c/2 times the change of dp */
            x[a] -= (real)0.5*w->h*w->constants.correction*force;
#endif
        }
    }
#if !GS_SCALAR_SCHUR
    position_increment(w, x);
#endif
}

/* force <- force - G^T impulse */
static void subtract_constraint_force(real G[ROOM][N], const real *impulse, real force[N])
{
    for (int a = 0; a < N; ++a) {
        for (int mu = 0; mu < M; ++mu) {
            force[a] -= G[mu][a]*impulse[mu];
        }
    }
}
#else
static void begin_iteration(state_t *w)
{
    (void)w;
}

static void correct_multipliers(state_t *w, real x[X], real G[ROOM][N])
{
    (void)w;
    (void)x;
    (void)G;
}

static void subtract_constraint_force(real G[ROOM][N], const real *impulse, real force[N])
{
    (void)G;
    (void)impulse;
    (void)force;
}
#endif

/*
 * One fixed-point iteration with Gauss-Seidel ordering: dq from dp, the impulses from g at the end,
 * dp from both. Returns the squared norm of the increment, relative to the state.
 */
static real iterate_once(state_t *w)
{
    real x[X];
    real G[ROOM][N];
    real force[N];
    real q_change = (real)0;
    real p_change = (real)0;
    for (int e = 0; e < X; ++e) {
        x[e] = w->x[e];
    }
    position_increment(w, x);
    correct_multipliers(w, x, G);
    momentum_increment(w, x, force);
    subtract_constraint_force(G, &x[IMPULSE], force);
    for (int a = 0; a < N; ++a) {
        x[HAT + a] = force[a];
        q_change += (x[a] - w->x[a])*(x[a] - w->x[a]);
        p_change += (force[a] - w->x[HAT + a])*(force[a] - w->x[HAT + a]);
    }
    for (int e = 0; e < X; ++e) {
        w->x[e] = x[e];
    }
    return (q_change*w->q_weight) + (p_change*w->p_weight);
}

/* The end of the step by compensated sums; `low` is their round-off. */
static void end_of_step(const state_t *w, real q[N], real p[N], real q_low[N], real p_low[N])
{
    real dq[N];
    real dp[N];
    for (int a = 0; a < N; ++a) {
        dq[a] = w->x[a] + w->q_low[a];
        dp[a] = w->x[HAT + a] + w->p_low[a];
    }
    add_compensated(w->q, dq, q, q_low);
    add_compensated(w->p, dp, p, p_low);
}

#endif
