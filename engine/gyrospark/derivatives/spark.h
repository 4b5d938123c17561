/*
 * SPARK methods: the linearised equations of a step and their transpose, on numbers or lanes.
 *
 * For a direction (dq, dp, dc, dt0, dh) of the start, the constants, the start time and the step,
 * J dx = -R' with R' the derivative of (B.1) at fixed x, and the derivative of T2 gives (dq1, dp1).
 * The transpose takes a cotangent of (q1, p1) to one of the start. A linearisation is evaluated
 * once at the solution x; docs/theory/derivatives.md has the equations.
 */
#if !GS_DERIVATIVES_IN_LANES
/*
 * r <- -dR of (B.1) at fixed unknowns, where Q_i, P_i and Q~_k change by dq, dp and dQ, constants and
 * times along dz; dz may be NULL with element templates.
 */
static void TYPED(residual_times)(TYPED(linearisation_t) *l, NUMBER dq[S][N], NUMBER dp[S][N],
    NUMBER dQ[P + 1][N], const NUMBER *dz, NUMBER r[U])
{
    const NUMBER zero = TYPED(broadcast)(0);
    NUMBER along[E], *dc = dz == NULL ? NULL : along;
    (void)dQ;
    for (int i = 0; i < S; ++i) {
        NUMBER velocity[N], force[N];
        for (int a = 0; a < N; ++a)
            velocity[a] = force[a] = zero;
        if (dz != NULL)
            TYPED(set_time_direction)(dz, TYPED(broadcast)(tableau.c[i]), along);
        TYPED(stage_times)(l, i, dq[i], dp[i], dc, force, velocity);
        for (int a = 0; a < N; ++a) {
            r[i*N + a] = velocity[a];
            r[K_HAT + i*N + a] = -force[a];
        }
    }
#if GS_CONSTRAINED
    for (int k = 1; k <= P; ++k) {
        NUMBER dg[M];
        if (dz != NULL)
            TYPED(set_time_direction)(dz, TYPED(broadcast)(tableau.c_tilde[k]), along);
        for (int m = 0; m < M; ++m)
            dg[m] = zero;
        TYPED(constraint_times)(l, k, dQ[k], dc, dg);
        for (int m = 0; m < M; ++m)
            r[LAMBDA + (k - 1)*M + m] = -dg[m];
    }
#endif
}
#endif

/*
 * Cotangents q, p and Q of Q_i, P_i and Q~_k: of x, those of -R of (B.1) at fixed unknowns, and of
 * `force`, those of the constraint forces, to which those of P_i are added. z, which may be NULL with
 * element templates, gets the cotangents of constants and times.
 */
static void TYPED(residual_transposed)(TYPED(linearisation_t) *l, const NUMBER x[U],
    NUMBER force[P][N], NUMBER q[S][N], NUMBER p[S][N], NUMBER Q[P + 1][N], NUMBER *z)
{
    const NUMBER h = l->h, zero = TYPED(broadcast)(0);
    NUMBER c_bar[E], *by_c = z == NULL ? NULL : c_bar;
    (void)h, (void)force, (void)Q;
    for (int i = 0; i < S; ++i) {
        NUMBER force_bar[N];
        const NUMBER *velocity_bar = x + i*N; /* of -R': dx <- (velocity, -force) */
        for (int a = 0; a < N; ++a) {
            force_bar[a] = -x[K_HAT + i*N + a];
            q[i][a] = p[i][a] = zero;
        }
        for (int e = 0; e < E && z != NULL; ++e)
            c_bar[e] = zero;
        TYPED(stage_transposed)(l, i, force_bar, velocity_bar, q[i], p[i], by_c);
        if (z != NULL)
            TYPED(add_time_cotangent)(c_bar, TYPED(broadcast)(tableau.c[i]), z);
#if GS_CONSTRAINED
        for (int k = 0; k < P; ++k)
            for (int a = 0; a < N; ++a)
                force[k][a] -= h*tableau.A_tilde[i][k]*p[i][a];
#endif
    }
#if GS_CONSTRAINED
    for (int k = 0; k <= P; ++k) {
        for (int a = 0; a < N; ++a)
            Q[k][a] = zero;
        for (int e = 0; e < E && z != NULL; ++e)
            c_bar[e] = zero;
        if (k < P)
            TYPED(force_transposed)(l, k, force[k], Q[k], by_c);
        if (k > 0) {
            NUMBER g_bar[M];
            for (int m = 0; m < M; ++m)
                g_bar[m] = -x[LAMBDA + (k - 1)*M + m];
            TYPED(constraint_transposed)(l, k, g_bar, Q[k], by_c);
        }
        if (z != NULL)
            TYPED(add_time_cotangent)(c_bar, TYPED(broadcast)(tableau.c_tilde[k]), z);
    }
#endif
}

#if GS_ELEMENTS && GS_FIXED_POINT
#include "gyrospark/derivatives/spark_iteration.h"
#endif
#include "gyrospark/derivatives/solution.h"

#if !GS_DERIVATIVES_IN_LANES
/*
 * dx and dz1 <- the derivatives of the unknowns and of (q1, p1) along dz: rows q, p, constants, t0,
 * h. multipliers, if not NULL, are those of Lambda_0..Lambda_P, the last of which is mu/(h b~_P).
 */
static int TYPED(step_tangent)(TYPED(linearisation_t) *l, const NUMBER dz[Z], NUMBER dx[U],
    NUMBER dz1[2*N], NUMBER *multipliers)
{
    const NUMBER h = l->h, zero = TYPED(broadcast)(0);
    NUMBER dq1[N], dp1[N], dq[S][N], dp[S][N], dQ[P + 1][N];
#if GS_CONSTRAINED
    NUMBER dc[E], dF[P][N];
    for (int k = 0; k < P; ++k) {
        for (int a = 0; a < N; ++a) {
            dQ[k][a] = dz[a] + l->node_rate[k][a]*dz[DH];
            dF[k][a] = zero;
        }
        TYPED(set_time_direction)(dz, TYPED(broadcast)(tableau.c_tilde[k]), dc);
        TYPED(force_times)(l, k, dQ[k], dc, dF[k]);
    }
#endif
    for (int a = 0; a < N; ++a) {
        dQ[P][a] = dz[a] + l->node_rate[P][a]*dz[DH];
        for (int i = 0; i < S; ++i) {
            dq[i][a] = dz[a] + l->q_rate[i][a]*dz[DH];
            dp[i][a] = dz[N + a] + l->p_rate[i][a]*dz[DH];
#if GS_CONSTRAINED
            for (int k = 0; k < P; ++k)
                dp[i][a] -= h*tableau.A_tilde[i][k]*dF[k][a];
#endif
        }
    }
    TYPED(residual_times)(l, dq, dp, dQ, dz, dx);
    const int status = TYPED(solve_step)(l, 0, dx);
    if (status != OK)
        return status;
    for (int a = 0; a < N; ++a) {
        NUMBER rate = zero, force = zero;
        for (int j = 0; j < S; ++j) {
            rate += tableau.b[j]*dx[j*N + a];
            force += tableau.b_hat[j]*dx[K_HAT + j*N + a];
        }
        dq1[a] = dz[a] + l->node_rate[P][a]*dz[DH] + h*rate;
        dp1[a] = dz[N + a] + l->end_rate[a]*dz[DH] + h*force;
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
        TYPED(force_times)(l, k, more, NULL, change);
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
    return OK;
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
    NUMBER nu[M], minus[N], by_c[E], Q[P + 1][N];
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
        TYPED(force_transposed)(l, k, force[k], Q[k], NULL);
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
    NUMBER q[S][N], p[S][N], Q[P + 1][N], by_h = TYPED(broadcast)(0);
    TYPED(residual_transposed)(l, x, force, q, p, Q, z);
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a) {
            z[a] += q[i][a];
            z[N + a] += p[i][a];
            by_h += l->q_rate[i][a]*q[i][a] + l->p_rate[i][a]*p[i][a];
        }
#if GS_CONSTRAINED
    for (int k = 0; k <= P; ++k)
        for (int a = 0; a < N; ++a) {
            z[a] += Q[k][a];
            by_h += l->node_rate[k][a]*Q[k][a];
        }
#endif
    z[DH] += by_h;
}

/* z <- the cotangent of (q, p, constants, t0, h) of those of (q1, p1), w, and of multipliers. */
static inline int TYPED(step_adjoint)(TYPED(linearisation_t) *l, const NUMBER w[2*N],
    const NUMBER *multipliers, NUMBER z[Z])
{
    NUMBER x[U], force[P][N];
    TYPED(adjoint_of_end)(l, w, multipliers, x, force, z);
    const int status = TYPED(solve_step)(l, 1, x);
    if (status == OK)
        TYPED(adjoint_of_stages)(l, x, force, z);
    return status;
}
