/* Profiles control and run: SPARK by fixed-point iteration. */
#ifndef GS_PROFILES_SPARK_H
#define GS_PROFILES_SPARK_H

#include "gyrospark/profiles/arithmetic.h"

/*
 * The scaled unknowns x: L = h b k and L^ = h b^ k^ of the stages, then the impulses h b~ Lambda.
 * Impulse l belongs to node l + 1, where g = 0 is imposed; the last one acts at node 0.
 */
enum { HAT = S*N, IMPULSE = 2*S*N, X = (2*S*N) + (P*M) };

/* y_i = base_i + sum_j table_ij x_j; rows have `width` numbers, rows of the base `stride`. */
static void multiply_table(int rows, int columns, int width, const real *base, int stride,
    const real *table, const real *x, real *y)
{
    for (int i = 0; i < rows; ++i) {
        for (int a = 0; a < width; ++a) {
            real sum = (base == NULL) ? (real)0 : base[(i*stride) + a];
            for (int j = 0; j < columns; ++j) {
                sum += table[(i*columns) + j]*x[(j*width) + a];
            }
            y[(i*width) + a] = sum;
        }
    }
}

/* Starting values without history: the rates at the start of the step, zero impulses. */
static void initial_unknowns(state_t *w)
{
    real H_q[N];
    real H_p[N];
    real shared[SHARED];
    first_rates(&w->constants, w->q, w->p, H_p, shared);
    second_rates(&w->constants, w->q, w->p, &w->t, shared, H_q);
    for (int e = 0; e < (S*N); ++e) {
        w->x[e] = w->h*weights[e/N]*H_p[e % N];
        w->x[HAT + e] = -(w->h*weights_hat[e/N])*H_q[e % N];
    }
    for (int e = IMPULSE; e < X; ++e) {
        w->x[e] = 0;
    }
}

#if GS_CONSTRAINED
/* The position of the node where impulse l acts; the last one acts at q. */
static void node_position(const state_t *w, int l, real place[N])
{
    for (int a = 0; a < N; ++a) {
        place[a] = w->q[a] + ((l < (P - 1)) ? w->D[(l*N) + a] : (real)0);
    }
}

/* C_i = p + sum_j nu~_ij Y_j with Y_j = -G(Q~_j)^T (impulse j) */
static void constraint_forces(state_t *w, real C[S*N])
{
    for (int j = 0; j < P; ++j) {
        const real *impulse = &w->x[IMPULSE + (j*M)];
        real place[N];
        real G[M][N];
        node_position(w, j, place);
        KERNEL(constraint_jacobian)(&w->constants, place, G);
        for (int a = 0; a < N; ++a) {
            w->Y[(j*N) + a] = 0;
            for (int mu = 0; mu < M; ++mu) {
                w->Y[(j*N) + a] -= G[mu][a]*impulse[mu];
            }
        }
    }
    multiply_table(S, P, N, w->p, 0, &table_nu_tilde[0][0], w->Y, C);
}

/*
 * Nodes Q~_l = q + D_l with D_l = sum_j nu_lj L_j of the starting values, their forces, and the
 * factors of W = G H_pp G^T there, unless W is constant where g = 0.
 */
static void begin_iteration(state_t *w)
{
    multiply_table(P, S, N, NULL, 0, &table_nu[0][0], w->x, w->D);
    constraint_forces(w, w->C);
#if !GS_CONSTANT_SCHUR
    for (int j = 0; j < P; ++j) {
        real place[N];
        node_position(w, j, place);
        schur(&w->constants, place, w->p, w->factors[j]);
        factorise(w->factors[j]);
    }
#endif
}

/* impulse += (h W)^-1 defect at node j */
static void apply_schur_inverse(state_t *w, int j, real defect[M], real impulse[M])
{
#if GS_CONSTANT_SCHUR
    (void)j;
    for (int mu = 0; mu < M; ++mu) {
        for (int nu = 0; nu < M; ++nu) {
            impulse[mu] += w->h_inverse*w->constants.W_inverse[mu][nu]*defect[nu];
        }
    }
#else
    substitute(w->factors[j], defect);
    for (int mu = 0; mu < M; ++mu) {
        impulse[mu] += w->h_inverse*defect[mu];
    }
#endif
}

/*
 * Corrects the impulses so that the nodes reached by L satisfy g = 0; C are the stage momenta of
 * the new forces. w->defect is the squared constraint error before the correction.
 */
static void correct_multipliers(state_t *w, const real L[S*N], real C[S*N])
{
    real g[P*M];
    real defect[P*M];
    multiply_table(P, S, N, NULL, 0, &table_nu[0][0], L, w->D);
    w->defect = 0;
    for (int l = 0; l < P; ++l) {
        KERNEL(constraint_increment)(&w->constants, w->q, &w->D[l*N], &g[l*M]);
        for (int mu = 0; mu < M; ++mu) {
            const real rest = g[(l*M) + mu] + w->g[mu];
            g[(l*M) + mu] = rest;
            w->defect += rest*rest*w->row_weight[mu]*w->q_weight;
        }
    }
    multiply_table(P, P, M, NULL, 0, &table_inverse[0][0], g, defect);
    for (int j = 0; j < P; ++j) {
        apply_schur_inverse(w, j, &defect[j*M], &w->x[IMPULSE + (j*M)]);
    }
    constraint_forces(w, C);
}

/* T2: adds the impulses to dp and projects p + dp onto f(q, p) = 0. */
static void project_momentum_increment(const state_t *w, const real q[N], real dp[N])
{
    real G[M][N];
    real impulses[N];
    KERNEL(constraint_jacobian)(&w->constants, q, G);
    total(P, w->Y, impulses);
    for (int a = 0; a < N; ++a) {
        dp[a] += impulses[a] + w->p_low[a];
    }
    for (int round = 0; round < ROUNDS; ++round) {
        real f[M];
        real p[N];
        real W[M][M];
        for (int a = 0; a < N; ++a) {
            p[a] = w->p[a] + dp[a];
        }
        KERNEL(hidden_constraint)(&w->constants, q, p, f);
        KERNEL(hidden_matrix)(&w->constants, q, p, W);
        factorise(W);
        substitute(W, f);
        for (int mu = 0; mu < M; ++mu) {
            for (int a = 0; a < N; ++a) {
                dp[a] -= G[mu][a]*f[mu];
            }
        }
    }
}

/*
 * Corrects P_i by the new impulses. With H_pp G^T = c G^T, L_i changes by h b c times as much;
 * otherwise H_p is evaluated again.
 */
static void correct_stages(state_t *w, const real Q[S*N], real momentum[S*N], real L[S*N])
{
    real C[S*N];
    correct_multipliers(w, L, C);
    for (int e = 0; e < (S*N); ++e) {
        const real force_change = C[e] - w->C[e];
        momentum[e] += force_change;
        w->C[e] = C[e];
#if GS_SCALAR_SCHUR
        L[e] += w->h*weights[e/N]*w->constants.correction*force_change;
#endif
    }
#if GS_SCALAR_SCHUR
    (void)Q;
#else
    for (int i = 0; i < S; ++i) {
        real H_p[N];
        real shared[SHARED];
        first_rates(&w->constants, &Q[i*N], &momentum[i*N], H_p, shared);
        for (int a = 0; a < N; ++a) {
            L[(i*N) + a] = w->h*weights[i]*H_p[a];
        }
    }
#endif
}
#else
/* C_i = p without impulses */
static void begin_iteration(state_t *w)
{
    for (int e = 0; e < (S*N); ++e) {
        w->C[e] = w->p[e % N];
    }
}

static void project_momentum_increment(const state_t *w, const real q[N], real dp[N])
{
    (void)q;
    for (int a = 0; a < N; ++a) {
        dp[a] += w->p_low[a];
    }
}
#endif

/*
 * One fixed-point iteration: k_i = H_p, correction of the impulses, k^_i = -H_q. Returns the
 * squared norm of the increment, relative to the state.
 */
static real iterate_once(state_t *w)
{
    real Q[S*N];
    real momentum[S*N];
    real L[S*N];
    real shared[S][SHARED];
    real q_change = (real)0;
    real p_change = (real)0;
    multiply_table(S, S, N, w->q, 0, &table_mu[0][0], w->x, Q);
    multiply_table(S, S, N, w->C, N, &table_mu_hat[0][0], &w->x[HAT], momentum);
    for (int i = 0; i < S; ++i) {
        real H_p[N];
        first_rates(&w->constants, &Q[i*N], &momentum[i*N], H_p, shared[i]);
        for (int a = 0; a < N; ++a) {
            L[(i*N) + a] = w->h*weights[i]*H_p[a];
        }
    }
#if GS_CONSTRAINED
    correct_stages(w, Q, momentum, L);
#endif
#if GS_SEPARABLE /* Gauss-Seidel ordering: H_q at the new positions squares the contraction */
    multiply_table(S, S, N, w->q, 0, &table_mu[0][0], L, Q);
#endif
    for (int i = 0; i < S; ++i) {
#if GS_FORCED_BY_TIME
        const real t = w->t + (w->h*nodes[i]);
#else
        const real t = w->t;
#endif
        real H_q[N];
        second_rates(&w->constants, &Q[i*N], &momentum[i*N], &t, shared[i], H_q);
        for (int a = 0; a < N; ++a) {
            const int e = (i*N) + a;
            const real force = -(w->h*weights_hat[i])*H_q[a];
            q_change += (L[e] - w->x[e])*(L[e] - w->x[e]);
            p_change += (force - w->x[HAT + e])*(force - w->x[HAT + e]);
            w->x[e] = L[e];
            w->x[HAT + e] = force;
        }
    }
    return (q_change*w->q_weight) + (p_change*w->p_weight);
}

/* T2: the end of the step by compensated sums; `low` is their round-off. */
static void end_of_step(const state_t *w, real q[N], real p[N], real q_low[N], real p_low[N])
{
    real dq[N];
    real dp[N];
    total(S, w->x, dq);
    total(S, &w->x[HAT], dp);
    for (int a = 0; a < N; ++a) {
        dq[a] += w->q_low[a];
    }
    add_compensated(w->q, dq, q, q_low);
    project_momentum_increment(w, q, dp);
    add_compensated(w->p, dp, p, p_low);
}

#endif
