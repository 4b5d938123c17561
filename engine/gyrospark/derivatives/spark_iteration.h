/*
 * SPARK methods: solutions with the Jacobian J of a step and its transpose by fixed-point iteration.
 *
 * The iteration of a step is x <- x - B r(x). B is the inverse of J without the derivatives of rates
 * by the stages, and with W of the nodes in the Schur complement of the multipliers. So J y = b is
 * solved by y <- y + B (b - J y), and J^T y = b by y <- y + B^T (b - J^T y), both at the rate at
 * which the step itself converges (Griewank, Walther: Evaluating Derivatives, chapter 15).
 */
#ifndef GS_DERIVATIVES_SPARK_ITERATION_H
#define GS_DERIVATIVES_SPARK_ITERATION_H

#include "gyrospark/tuning.h"

#if GS_CONSTRAINED
/* The place in table_inverse of the node k of multipliers, 0..P - 1; of constraints, 1..P */
static inline int multiplier_place(int k)
{
    return k == 0 ? P - 1 : k - 1;
}

/* (t_1..t_P) of constraints <- (Lambda_0..Lambda_(P-1)) = -S^-1 t, S_lj = h^2 (A_bar A~)_lj W_j */
static void solve_schur(linearisation_t *l, real *t)
{
    real mixed[P][M];
    for (int k = 0; k < P; ++k) {
        const real factor = -1/(l->h*l->h*tableau.b_tilde[k]);
        for (int m = 0; m < M; ++m) {
            mixed[k][m] = 0;
            for (int j = 0; j < P; ++j)
                mixed[k][m] += factor*table_inverse[multiplier_place(k)][j]*t[j*M + m];
        }
        substitute(l->W[k], mixed[k]);
    }
    for (int e = 0; e < P*M; ++e)
        t[e] = mixed[e/M][e % M];
}

/* The transpose of solve_schur: W is symmetric. */
static void solve_schur_transposed(linearisation_t *l, real *t)
{
    real mixed[P][M];
    for (int k = 0; k < P; ++k) {
        const real factor = -1/(l->h*l->h*tableau.b_tilde[k]);
        for (int m = 0; m < M; ++m)
            mixed[k][m] = factor*t[k*M + m];
        substitute(l->W[k], mixed[k]);
    }
    for (int e = 0; e < P*M; ++e) {
        t[e] = 0;
        for (int k = 0; k < P; ++k)
            t[e] += table_inverse[multiplier_place(k)][e/M]*mixed[k][e % M];
    }
}

/* dP_i -= h sum A~_ik G_k^T Lambda_k */
static void add_multipliers_of_nodes(linearisation_t *l, const real *lambda, real dp[S][N])
{
    for (int k = 0; k < P; ++k) {
        real force[N] = { 0 };
        constraint_transposed(l, k, lambda + k*M, force, NULL);
        for (int i = 0; i < S; ++i)
            for (int a = 0; a < N; ++a)
                dp[i][a] -= l->h*tableau.A_tilde[i][k]*force[a];
    }
}
#endif

/* y <- J x */
static void jacobian_times(linearisation_t *l, const real x[U], real y[U])
{
    real dq[S][N], dp[S][N], dQ[P + 1][N];
    for (int a = 0; a < N; ++a) {
        for (int i = 0; i < S; ++i) {
            dq[i][a] = dp[i][a] = 0;
            for (int j = 0; j < S; ++j) {
                dq[i][a] += l->h*tableau.A[i][j]*x[j*N + a];
                dp[i][a] += l->h*tableau.A_hat[i][j]*x[K_HAT + j*N + a];
            }
        }
        for (int k = 0; k <= P; ++k) {
            dQ[k][a] = 0;
            for (int j = 0; j < S; ++j)
                dQ[k][a] += l->h*tableau.A_bar[k][j]*x[j*N + a];
        }
    }
#if GS_CONSTRAINED
    for (int k = 0; k < P; ++k) {
        real force[N] = { 0 };
        force_times(l, k, dQ[k], NULL, force);
        for (int i = 0; i < S; ++i)
            for (int a = 0; a < N; ++a)
                dp[i][a] -= l->h*tableau.A_tilde[i][k]*force[a];
    }
    add_multipliers_of_nodes(l, x + LAMBDA, dp);
#endif
    residual_times(l, dq, dp, dQ, NULL, y);
    for (int e = 0; e < U; ++e)
        y[e] = (e < LAMBDA ? x[e] : 0) - y[e];
}

/* y <- J^T x */
static void jacobian_transposed(linearisation_t *l, const real x[U], real y[U])
{
    real force[P > 0 ? P : 1][N] = { { 0 } }, q[S][N], p[S][N], Q[P + 1][N] = { { 0 } };
    residual_transposed(l, x, force, q, p, Q, NULL);
    for (int j = 0; j < S; ++j)
        for (int a = 0; a < N; ++a) {
            real by_rate = 0, by_force = 0;
            for (int i = 0; i < S; ++i) {
                by_rate += tableau.A[i][j]*q[i][a];
                by_force += tableau.A_hat[i][j]*p[i][a];
            }
            for (int k = 0; k <= P; ++k)
                by_rate += tableau.A_bar[k][j]*Q[k][a];
            y[j*N + a] = x[j*N + a] - l->h*by_rate;
            y[K_HAT + j*N + a] = x[K_HAT + j*N + a] - l->h*by_force;
        }
#if GS_CONSTRAINED
    for (int k = 0; k < P; ++k) {
        real change[M] = { 0 };
        constraint_times(l, k, force[k], NULL, change);
        for (int m = 0; m < M; ++m)
            y[LAMBDA + k*M + m] = -change[m];
    }
#endif
}

#if GS_CONSTRAINED
/* r <- B r */
static void precondition(linearisation_t *l, real r[U])
{
    const real zero[N] = { 0 };
    real dp[S][N] = { { 0 } }, *t = r + LAMBDA;
    for (int k = 1; k <= P; ++k) {
        real dQ[N], change[M] = { 0 };
        for (int a = 0; a < N; ++a) {
            dQ[a] = 0;
            for (int j = 0; j < S; ++j)
                dQ[a] += l->h*tableau.A_bar[k][j]*r[j*N + a];
        }
        constraint_times(l, k, dQ, NULL, change);
        for (int m = 0; m < M; ++m)
            t[(k - 1)*M + m] -= change[m];
    }
    solve_schur(l, t);
    add_multipliers_of_nodes(l, t, dp);
    for (int i = 0; i < S; ++i) {
        real force[N] = { 0 };
        stage_times(l, i, zero, dp[i], NULL, force, r + i*N);
        for (int a = 0; a < N; ++a)
            r[K_HAT + i*N + a] -= force[a];
    }
}

/* r <- B^T r */
static void precondition_transposed(linearisation_t *l, real r[U])
{
    real force[P][N] = { { 0 } }, *t = r + LAMBDA;
    for (int i = 0; i < S; ++i) {
        real force_bar[N], q[N] = { 0 }, p[N] = { 0 };
        for (int a = 0; a < N; ++a)
            force_bar[a] = -r[K_HAT + i*N + a];
        stage_transposed(l, i, force_bar, r + i*N, q, p, NULL);
        for (int k = 0; k < P; ++k)
            for (int a = 0; a < N; ++a)
                force[k][a] -= l->h*tableau.A_tilde[i][k]*p[a];
    }
    for (int k = 0; k < P; ++k)
        constraint_times(l, k, force[k], NULL, t + k*M);
    solve_schur_transposed(l, t);
    for (int k = 1; k <= P; ++k) {
        real by_q[N] = { 0 };
        constraint_transposed(l, k, t + (k - 1)*M, by_q, NULL);
        for (int j = 0; j < S; ++j)
            for (int a = 0; a < N; ++a)
                r[j*N + a] -= l->h*tableau.A_bar[k][j]*by_q[a];
    }
}
#else
/* Without constraints B is the unit matrix. */
static void precondition(linearisation_t *l, real r[U])
{
    (void)l, (void)r;
}

static void precondition_transposed(linearisation_t *l, real r[U])
{
    (void)l, (void)r;
}
#endif

/*
 * b <- J^-1 b, or J^-T b, by the iteration; returns 0, with b as it was, where that takes too long.
 * Norms are of k and k^, relative to q and p: increments of the other unknowns follow from theirs.
 */
static int iterate_step(linearisation_t *l, int transposed, real b[U])
{
    const real p_size = norm(N, l->p) + MATH(fabs)(l->h)*norm(S*N, l->x + K_HAT),
        q_scale = norm(N, l->q), ratio_of_scales = q_scale > 0 && p_size > 0 ? q_scale/p_size : 1,
        weight = transposed ? 1/(ratio_of_scales*ratio_of_scales) : ratio_of_scales*ratio_of_scales;
    real previous = (real)HUGE_VAL, two_ago = previous;
    for (int e = 0; e < U; ++e) {
        l->right_side[e] = l->rest[e] = b[e];
        b[e] = 0;
    }
    for (int iteration = 1; iteration <= MOST_DERIVATIVE_ITERATIONS; ++iteration) {
        real size = 0, change = 0;
        for (int e = 0; e < U; ++e)
            l->increment[e] = l->rest[e];
        if (transposed)
            precondition_transposed(l, l->increment);
        else
            precondition(l, l->increment);
        for (int e = 0; e < U; ++e) {
            const real scale = e < K_HAT ? 1 : e < LAMBDA ? weight : 0;
            b[e] += l->increment[e];
            size += scale*b[e]*b[e];
            change += scale*l->increment[e]*l->increment[e];
        }
        const real mean = iteration < 3 ? change/previous : MATH(sqrt)(change/two_ago),
            rate = larger(mean, MIN_RATE);
        if (DERIVATIVE_MARGIN*change*rate <= epsilon*epsilon*size)
            return 1;
        if (iteration > 2 && !(rate < SLOW_RATE))
            break;
        if (transposed)
            jacobian_transposed(l, l->increment, l->product);
        else
            jacobian_times(l, l->increment, l->product);
        for (int e = 0; e < U; ++e)
            l->rest[e] -= l->product[e];
        two_ago = previous;
        previous = change;
    }
    for (int e = 0; e < U; ++e)
        b[e] = l->right_side[e];
    return 0;
}

#endif
