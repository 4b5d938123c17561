/*
 * SPARK methods: the linearised equations of a step and their transpose, on numbers or lanes.
 *
 * For a direction (dq, dp, dc, dt0, dh) of the start, the constants, the start time and the step,
 * J dx = -R' with R' the derivative of (B.1) at fixed x, and the derivative of T2 gives (dq1, dp1).
 * The transpose takes a cotangent of (q1, p1) to one of the start. A linearisation is evaluated
 * once at the solution x; docs/theory/derivatives.md has the equations.
 */
#include "gyrospark/derivatives/solution.h"

#if !GS_DERIVATIVES_IN_LANES
/*
 * dx and dz1 <- the derivatives of the unknowns and of (q1, p1) along dz: rows q, p, constants, t0,
 * h. multipliers, if not NULL, are those of Lambda_0..Lambda_P, the last of which is mu/(h b~_P).
 */
static void TYPED(step_tangent)(TYPED(linearisation_t) *l, const NUMBER dz[Z], NUMBER dx[U],
    NUMBER dz1[2*N], NUMBER *multipliers)
{
    const NUMBER h = l->h, zero = TYPED(broadcast)(0);
    NUMBER dc[E], dq1[N], dp1[N];
#if GS_CONSTRAINED
    NUMBER dQ[P + 1][N], dF[P][N];
    for (int k = 0; k <= P; ++k)
        for (int a = 0; a < N; ++a)
            dQ[k][a] = dz[a] + l->node_rate[k][a]*dz[DH];
    for (int k = 0; k < P; ++k) {
        TYPED(set_time_direction)(dz, TYPED(broadcast)(tableau.c_tilde[k]), dc);
        for (int a = 0; a < N; ++a)
            dF[k][a] = zero;
        TYPED(force_times)(l, k, dQ[k], dc, dF[k]);
    }
#endif
    for (int i = 0; i < S; ++i) {
        NUMBER dq[N], dp[N], velocity[N], force[N];
        for (int a = 0; a < N; ++a) {
            dq[a] = dz[a] + l->q_rate[i][a]*dz[DH];
            dp[a] = dz[N + a] + l->p_rate[i][a]*dz[DH];
#if GS_CONSTRAINED
            for (int k = 0; k < P; ++k)
                dp[a] -= h*tableau.A_tilde[i][k]*dF[k][a];
#endif
            velocity[a] = force[a] = zero;
        }
        TYPED(set_time_direction)(dz, TYPED(broadcast)(tableau.c[i]), dc);
        TYPED(stage_times)(l, i, dq, dp, dc, force, velocity);
        for (int a = 0; a < N; ++a) {
            dx[i*N + a] = velocity[a];
            dx[K_HAT + i*N + a] = -force[a];
        }
    }
#if GS_CONSTRAINED
    for (int k = 1; k <= P; ++k) {
        NUMBER dg[M];
        TYPED(set_time_direction)(dz, TYPED(broadcast)(tableau.c_tilde[k]), dc);
        for (int m = 0; m < M; ++m)
            dg[m] = zero;
        TYPED(constraint_times)(l, k, dQ[k], dc, dg);
        for (int m = 0; m < M; ++m)
            dx[LAMBDA + (k - 1)*M + m] = -dg[m];
    }
#endif
    TYPED(solve_step)(l, dx);
    for (int a = 0; a < N; ++a) {
        NUMBER dq = zero, dp = zero;
        for (int j = 0; j < S; ++j) {
            dq += tableau.b[j]*dx[j*N + a];
            dp += tableau.b_hat[j]*dx[K_HAT + j*N + a];
        }
        dq1[a] = dz[a] + l->node_rate[P][a]*dz[DH] + h*dq;
        dp1[a] = dz[N + a] + l->end_rate[a]*dz[DH] + h*dp;
    }
#if GS_CONSTRAINED
    for (int k = 0; k < P; ++k) {
        NUMBER more[N], change[N];
        for (int a = 0; a < N; ++a) {
            more[a] = zero;
            for (int j = 0; j < S; ++j)
                more[a] += h*tableau.A_bar[k][j]*dx[j*N + a];
            change[a] = dF[k][a];
        }
        for (int e = 0; e < E; ++e)
            dc[e] = zero;
        TYPED(force_times)(l, k, more, dc, change);
        TYPED(constraint_transposed)(l, k, dx + LAMBDA + k*M, change, NULL);
        for (int a = 0; a < N; ++a)
            dp1[a] -= h*tableau.b_tilde[k]*change[a];
    }
    NUMBER turn[N], df[M];
    TYPED(set_time_direction)(dz, TYPED(broadcast)(1), dc);
    for (int a = 0; a < N; ++a)
        turn[a] = zero;
    for (int m = 0; m < M; ++m)
        df[m] = zero;
    TYPED(force_times)(l, P, dq1, dc, turn);
    for (int a = 0; a < N; ++a)
        dp1[a] -= turn[a];
    TYPED(hidden_times)(l, dq1, dp1, dc, df);
    TYPED(solve_hidden)(l, df);
    for (int e = 0; e < P*M && multipliers != NULL; ++e)
        multipliers[e] = dx[LAMBDA + e];
    for (int m = 0; m < M && multipliers != NULL; ++m)
        multipliers[P*M + m] = (df[m] - l->impulse[m]*dz[DH]/h)/(h*tableau.b_tilde[P]);
    for (int m = 0; m < M; ++m)
        df[m] = -df[m];
    TYPED(constraint_transposed)(l, P, df, dp1, NULL);
#endif
    for (int a = 0; a < N; ++a) {
        dz1[a] = dq1[a];
        dz1[N + a] = dp1[a];
    }
    (void)multipliers;
}
#endif

/*
 * The transposed derivative of T2: the cotangent w of (q1, p1), and that of Lambda_0..Lambda_P,
 * multipliers, if not NULL, become one of the unknowns, x, and of the constraint forces at fixed
 * unknowns; z begins with what does not depend on the unknowns.
 */
static void TYPED(adjoint_of_end)(TYPED(linearisation_t) *l, const NUMBER w[2*N],
    const NUMBER *multipliers, NUMBER x[U], NUMBER force[P][N], NUMBER z[Z])
{
    const NUMBER h = l->h, zero = TYPED(broadcast)(0);
    NUMBER q_end[N], p_end[N], by_h = zero;
    for (int e = 0; e < Z; ++e)
        z[e] = zero;
    for (int a = 0; a < N; ++a) {
        q_end[a] = w[a];
        p_end[a] = w[N + a];
    }
#if GS_CONSTRAINED
    NUMBER nu[M], minus[N], by_c[E], none[E], Q[P + 1][N];
    for (int e = 0; e < E; ++e)
        by_c[e] = zero;
    for (int m = 0; m < M; ++m)
        nu[m] = zero;
    TYPED(constraint_times)(l, P, p_end, NULL, nu);
    for (int m = 0; m < M && multipliers != NULL; ++m) { /* Lambda_P = mu/(h b~_P) */
        const NUMBER impulse_bar = multipliers[P*M + m]/(h*tableau.b_tilde[P]);
        nu[m] -= impulse_bar;
        by_h -= impulse_bar*l->impulse[m]/h;
    }
    TYPED(solve_hidden_transposed)(l, nu);
    for (int m = 0; m < M; ++m)
        nu[m] = -nu[m];
    TYPED(hidden_transposed)(l, nu, q_end, p_end, by_c);
    for (int a = 0; a < N; ++a)
        minus[a] = -p_end[a];
    TYPED(force_transposed)(l, P, minus, q_end, by_c);
    TYPED(add_time_cotangent)(by_c, TYPED(broadcast)(1), z);
    for (int k = 0; k < P; ++k) {
        for (int a = 0; a < N; ++a) {
            force[k][a] = -h*tableau.b_tilde[k]*p_end[a];
            Q[k][a] = zero;
        }
        for (int e = 0; e < E; ++e)
            none[e] = zero;
        TYPED(force_transposed)(l, k, force[k], Q[k], none);
        for (int m = 0; m < M; ++m)
            x[LAMBDA + k*M + m] = multipliers == NULL ? zero : multipliers[k*M + m];
        TYPED(constraint_times)(l, k, force[k], NULL, x + LAMBDA + k*M);
    }
#endif
    for (int j = 0; j < S; ++j)
        for (int a = 0; a < N; ++a) {
            NUMBER sum = tableau.b[j]*q_end[a];
#if GS_CONSTRAINED
            for (int k = 0; k < P; ++k)
                sum += tableau.A_bar[k][j]*Q[k][a];
#endif
            x[j*N + a] = h*sum;
            x[K_HAT + j*N + a] = h*tableau.b_hat[j]*p_end[a];
        }
    for (int a = 0; a < N; ++a) {
        z[a] += q_end[a];
        z[N + a] += p_end[a];
        by_h += l->node_rate[P][a]*q_end[a] + l->end_rate[a]*p_end[a];
    }
    z[DH] += by_h;
    (void)force, (void)multipliers;
}

/* The transposed derivative of (B.1) at fixed unknowns, of x <- J^-T x, added to z. */
static void TYPED(adjoint_of_stages)(TYPED(linearisation_t) *l, const NUMBER x[U],
    NUMBER force[P][N], NUMBER z[Z])
{
    const NUMBER h = l->h, zero = TYPED(broadcast)(0);
    NUMBER by_c[E], by_h = zero;
    (void)h, (void)force;
    for (int i = 0; i < S; ++i) {
        NUMBER force_bar[N], dq[N], dp[N];
        const NUMBER *velocity_bar = x + i*N; /* of -R': dx <- (velocity, -force) */
        for (int a = 0; a < N; ++a) {
            force_bar[a] = -x[K_HAT + i*N + a];
            dq[a] = dp[a] = zero;
        }
        for (int e = 0; e < E; ++e)
            by_c[e] = zero;
        TYPED(stage_transposed)(l, i, force_bar, velocity_bar, dq, dp, by_c);
        TYPED(add_time_cotangent)(by_c, TYPED(broadcast)(tableau.c[i]), z);
        for (int a = 0; a < N; ++a) {
            z[a] += dq[a];
            z[N + a] += dp[a];
            by_h += l->q_rate[i][a]*dq[a] + l->p_rate[i][a]*dp[a];
#if GS_CONSTRAINED
            for (int k = 0; k < P; ++k)
                force[k][a] -= h*tableau.A_tilde[i][k]*dp[a];
#endif
        }
    }
#if GS_CONSTRAINED
    for (int k = 0; k <= P; ++k) {
        NUMBER dQ[N];
        for (int a = 0; a < N; ++a)
            dQ[a] = zero;
        for (int e = 0; e < E; ++e)
            by_c[e] = zero;
        if (k < P) {
            TYPED(force_transposed)(l, k, force[k], dQ, by_c);
        }
        if (k > 0) {
            NUMBER g_bar[M];
            for (int m = 0; m < M; ++m)
                g_bar[m] = -x[LAMBDA + (k - 1)*M + m];
            TYPED(constraint_transposed)(l, k, g_bar, dQ, by_c);
        }
        TYPED(add_time_cotangent)(by_c, TYPED(broadcast)(tableau.c_tilde[k]), z);
        for (int a = 0; a < N; ++a) {
            z[a] += dQ[a];
            by_h += l->node_rate[k][a]*dQ[a];
        }
    }
#endif
    z[DH] += by_h;
}

/* z <- the cotangent of (q, p, constants, t0, h) of those of (q1, p1), w, and of multipliers. */
static inline void TYPED(step_adjoint)(TYPED(linearisation_t) *l, const NUMBER w[2*N],
    const NUMBER *multipliers, NUMBER z[Z])
{
    NUMBER x[U], force[P][N];
    TYPED(adjoint_of_end)(l, w, multipliers, x, force, z);
    TYPED(solve_step_transposed)(l, x);
    TYPED(adjoint_of_stages)(l, x, force, z);
}
