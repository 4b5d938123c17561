/*
 * SPARK methods: the linearised equations of a step and their transpose, on numbers or lanes.
 *
 * For a direction (dq, dp, dc, dt0, dh) of the start, the constants, the start time and the step,
 * J dx = -R' with R' the derivative of (B.1) at fixed x, and the derivative of T2 gives (dq1, dp1).
 * The transpose takes a cotangent of (q1, p1) to one of the start. A linearisation is evaluated
 * once at the solution x; docs/theory/derivatives.md has the equations.
 */

/* What derivatives of one step are made of. Index P of the nodes is the end of the step. */
typedef struct {
    NUMBER h, x[U];
    NUMBER q_rate[S][N], p_rate[S][N]; /* derivatives of Q_i and P_i by h at fixed x */
    NUMBER node_rate[P + 1][N], end_rate[N]; /* those of Q~_l, and of p1 before its projection */
    NUMBER H_qq[S][N][N], H_qp[S][N][N], H_pq[S][N][N], H_pp[S][N][N]; /* of H_q - F and H_p */
    NUMBER H_qc[S][N][E], H_pc[S][N][E];
#if GS_CONSTRAINED
    NUMBER G[P + 1][M][N], K[P + 1][N][N]; /* K[P] with the impulse of the projection */
    NUMBER g_c[P + 1][M][E], force_c[P + 1][N][E];
    NUMBER f_q[M][N], f_p[M][N], f_c[M][E]; /* hidden constraints at the end */
    NUMBER W[M*M]; /* f_p G^T */
    TYPED(pivots_t) W_pivots[2*M];
#endif
    NUMBER J[U*U];
    TYPED(pivots_t) pivots[2*U];
} TYPED(linearisation_t);

#if !GS_LAGRANGIAN
/* Derivatives of H_q - F and H_p by q, p, and constants. */
static inline void TYPED(rates_derivative)(const TYPED(constants) *c, const NUMBER q[N],
    const NUMBER p[N], const NUMBER t[1], NUMBER H_qq[N][N], NUMBER H_qp[N][N], NUMBER H_pq[N][N],
    NUMBER H_pp[N][N], NUMBER H_qc[N][E], NUMBER H_pc[N][E])
{
    TYPED(rates_by_state)(c, q, p, t, H_qq, H_qp, H_pq, H_pp);
    TYPED(rates_by_constants)(c, q, p, t, H_qc, H_pc);
}
#endif

#if GS_CONSTRAINED
/* Constraint forces of the nodes; their derivatives are those of the stage momenta. */
static void TYPED(linearise_nodes)(TYPED(constants) *c, NUMBER t, NUMBER h, const NUMBER q[N],
    const NUMBER x[U], NUMBER force[P][N], TYPED(linearisation_t) *l)
{
    for (int k = 0; k <= P; ++k) {
        NUMBER Q[N];
        const TYPED(constants) *at = TYPED_AT(c, t + h*tableau.c_tilde[k]);
        (void)t;
        for (int a = 0; a < N; ++a) {
            NUMBER sum = TYPED(broadcast)(0);
            for (int j = 0; j < S; ++j)
                sum += tableau.A_bar[k][j]*x[j*N + a];
            l->node_rate[k][a] = sum;
            Q[a] = q[a] + h*sum;
        }
        TYPED(constraint_jacobian)(at, Q, l->G[k]);
        if (k == P)
            break;
        const NUMBER *lambda = x + LAMBDA + k*M;
        TYPED(constraint_curvature)(at, Q, lambda, l->K[k]);
        TYPED(force_by_constants)(at, Q, lambda, l->force_c[k]);
        TYPED(constraint_by_constants)(at, Q, l->g_c[k]);
        for (int a = 0; a < N; ++a) {
            force[k][a] = l->G[k][0][a]*lambda[0];
            for (int mu = 1; mu < M; ++mu)
                force[k][a] += l->G[k][mu][a]*lambda[mu];
        }
    }
}

/* The end of the step: p1 = P - G^T mu with f(q1, p1) = 0; P - p1 determines mu. */
static int TYPED(linearise_end)(TYPED(constants) *c, NUMBER t, const NUMBER q1[N],
    const NUMBER p1[N], const NUMBER p_end[N], TYPED(linearisation_t) *l)
{
    NUMBER mu[M];
    const TYPED(constants) *at = TYPED_AT(c, t);
    (void)t;
    TYPED(hidden_derivative)(at, q1, p1, l->f_q, l->f_p, l->f_c);
    for (int m = 0; m < M; ++m) {
        mu[m] = TYPED(broadcast)(0);
        for (int a = 0; a < N; ++a)
            mu[m] += l->f_p[m][a]*(p_end[a] - p1[a]);
        for (int k = 0; k < M; ++k) {
            l->W[m*M + k] = TYPED(broadcast)(0);
            for (int a = 0; a < N; ++a)
                l->W[m*M + k] += l->f_p[m][a]*l->G[P][k][a];
        }
    }
    const int status = TYPED(factorise)(M, l->W, l->W_pivots);
    if (status != OK)
        return status;
    TYPED(solve_with)(M, l->W, l->W_pivots, mu);
    TYPED(constraint_curvature)(at, q1, mu, l->K[P]);
    TYPED(force_by_constants)(at, q1, mu, l->force_c[P]);
    TYPED(constraint_by_constants)(at, q1, l->g_c[P]);
    return OK;
}
#endif

/* J = dr/dx of (B.1), as spark/jacobian.h has it, from the linearisation. */
static void TYPED(assemble_jacobian)(TYPED(linearisation_t) *l)
{
    NUMBER *J = l->J;
    const NUMBER h = l->h, zero = TYPED(broadcast)(0), unit = TYPED(broadcast)(1);
    for (int e = 0; e < U*U; ++e)
        J[e] = zero;
    for (int i = 0; i < S; ++i) {
        for (int j = 0; j < S; ++j) {
            const NUMBER a_ij = h*tableau.A[i][j], a_hat = h*tableau.A_hat[i][j];
#if GS_CONSTRAINED
            NUMBER B[N][N];
            for (int a = 0; a < N; ++a)
                for (int b = 0; b < N; ++b) {
                    NUMBER sum = zero;
                    for (int k = 0; k < P; ++k)
                        sum += tableau.A_tilde[i][k]*tableau.A_bar[k][j]*l->K[k][a][b];
                    B[a][b] = -h*h*sum;
                }
#endif
            for (int a = 0; a < N; ++a) {
                NUMBER *upper = J + (i*N + a)*U, *lower = J + (K_HAT + i*N + a)*U;
                for (int b = 0; b < N; ++b) {
                    const NUMBER one = i == j && a == b ? unit : zero;
                    NUMBER by_k = a_ij*l->H_pq[i][a][b], by_k_lower = a_ij*l->H_qq[i][a][b];
#if GS_CONSTRAINED
                    for (int e = 0; e < N; ++e) {
                        by_k += l->H_pp[i][a][e]*B[e][b];
                        by_k_lower += l->H_qp[i][a][e]*B[e][b];
                    }
#endif
                    upper[j*N + b] = one - by_k;
                    upper[K_HAT + j*N + b] = -a_hat*l->H_pp[i][a][b];
                    lower[j*N + b] = by_k_lower;
                    lower[K_HAT + j*N + b] = one + a_hat*l->H_qp[i][a][b];
                }
            }
        }
#if GS_CONSTRAINED
        for (int m = 0; m < M; ++m)
            for (int k = 0; k < P; ++k)
                for (int a = 0; a < N; ++a) {
                    NUMBER by_p = zero, by_p_lower = zero;
                    for (int e = 0; e < N; ++e) {
                        by_p += l->H_pp[i][a][e]*l->G[k][m][e];
                        by_p_lower += l->H_qp[i][a][e]*l->G[k][m][e];
                    }
                    const NUMBER a_tilde = h*tableau.A_tilde[i][k];
                    J[(i*N + a)*U + LAMBDA + k*M + m] = a_tilde*by_p;
                    J[(K_HAT + i*N + a)*U + LAMBDA + k*M + m] = -a_tilde*by_p_lower;
                }
#endif
    }
#if GS_CONSTRAINED
    for (int k = 1; k <= P; ++k)
        for (int m = 0; m < M; ++m)
            for (int j = 0; j < S; ++j)
                for (int b = 0; b < N; ++b)
                    J[(LAMBDA + (k - 1)*M + m)*U + j*N + b] = h*tableau.A_bar[k][j]*l->G[k][m][b];
#endif
}

/*
 * Linearises the step from (q, p) with the unknowns x to (q1, p1), which starts at t. `c` are the
 * constants, in which the time may be set.
 */
static int TYPED(linearise)(TYPED(constants) *c, NUMBER t, NUMBER h, const NUMBER q[N],
    const NUMBER p[N], const NUMBER x[U], const NUMBER q1[N], const NUMBER p1[N],
    TYPED(linearisation_t) *l)
{
    NUMBER p_end[N];
    l->h = h;
    for (int e = 0; e < U; ++e)
        l->x[e] = x[e];
#if GS_CONSTRAINED
    NUMBER force[P][N];
    TYPED(linearise_nodes)(c, t, h, q, x, force, l);
#else
    (void)q1, (void)p1;
#endif
    for (int i = 0; i < S; ++i) {
        NUMBER Q[N], momentum[N];
        const NUMBER stage_time = t + h*tableau.c[i];
        for (int a = 0; a < N; ++a) {
            NUMBER rate = TYPED(broadcast)(0), change = TYPED(broadcast)(0);
            for (int j = 0; j < S; ++j) {
                rate += tableau.A[i][j]*x[j*N + a];
                change += tableau.A_hat[i][j]*x[K_HAT + j*N + a];
            }
#if GS_CONSTRAINED
            for (int k = 0; k < P; ++k)
                change -= tableau.A_tilde[i][k]*force[k][a];
#endif
            l->q_rate[i][a] = rate;
            l->p_rate[i][a] = change;
            Q[a] = q[a] + h*rate;
            momentum[a] = p[a] + h*change;
        }
        const TYPED(constants) *at = TYPED_AT(c, stage_time);
        TYPED(rates_derivative)(at, Q, momentum, &stage_time, l->H_qq[i], l->H_qp[i], l->H_pq[i],
            l->H_pp[i], l->H_qc[i], l->H_pc[i]);
    }
    for (int a = 0; a < N; ++a) {
        NUMBER rate = TYPED(broadcast)(0), change = TYPED(broadcast)(0);
        for (int j = 0; j < S; ++j) {
            rate += tableau.b[j]*x[j*N + a];
            change += tableau.b_hat[j]*x[K_HAT + j*N + a];
        }
#if GS_CONSTRAINED
        for (int k = 0; k < P; ++k)
            change -= tableau.b_tilde[k]*force[k][a];
#endif
        l->node_rate[P][a] = rate;
        l->end_rate[a] = change;
        p_end[a] = p[a] + h*change;
    }
#if GS_CONSTRAINED
    const int status = TYPED(linearise_end)(c, t + h, q1, p1, p_end, l);
    if (status != OK)
        return status;
#else
    (void)p_end;
#endif
    TYPED(assemble_jacobian)(l);
    return TYPED(factorise)(U, l->J, l->pivots);
}

/* dz1 <- the derivative of (q1, p1) along dz: rows q, p, constants, t0, h. */
static void TYPED(step_tangent)(const TYPED(linearisation_t) *l, const NUMBER dz[Z],
    NUMBER dz1[2*N])
{
    const NUMBER h = l->h, zero = TYPED(broadcast)(0);
    NUMBER dx[U], dc[E], dq1[N], dp1[N];
#if GS_CONSTRAINED
    NUMBER dQ[P + 1][N], dF[P][N];
    for (int k = 0; k <= P; ++k)
        for (int a = 0; a < N; ++a)
            dQ[k][a] = dz[a] + l->node_rate[k][a]*dz[DH];
    for (int k = 0; k < P; ++k) {
        TYPED(set_time_direction)(dz, TYPED(broadcast)(tableau.c_tilde[k]), dc);
        for (int a = 0; a < N; ++a)
            dF[k][a] = zero;
        TYPED(add_times)(N, N, &l->K[k][0][0], dQ[k], dF[k]);
        TYPED(add_times)(N, E, &l->force_c[k][0][0], dc, dF[k]);
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
        TYPED(add_times)(N, N, &l->H_qq[i][0][0], dq, force);
        TYPED(add_times)(N, N, &l->H_qp[i][0][0], dp, force);
        TYPED(add_times)(N, E, &l->H_qc[i][0][0], dc, force);
        TYPED(add_times)(N, N, &l->H_pq[i][0][0], dq, velocity);
        TYPED(add_times)(N, N, &l->H_pp[i][0][0], dp, velocity);
        TYPED(add_times)(N, E, &l->H_pc[i][0][0], dc, velocity);
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
        TYPED(add_times)(M, N, &l->G[k][0][0], dQ[k], dg);
        TYPED(add_times)(M, E, &l->g_c[k][0][0], dc, dg);
        for (int m = 0; m < M; ++m)
            dx[LAMBDA + (k - 1)*M + m] = -dg[m];
    }
#endif
    TYPED(solve_with)(U, l->J, l->pivots, dx);
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
        TYPED(add_times)(N, N, &l->K[k][0][0], more, change);
        TYPED(add_transposed)(M, N, &l->G[k][0][0], dx + LAMBDA + k*M, change);
        for (int a = 0; a < N; ++a)
            dp1[a] -= h*tableau.b_tilde[k]*change[a];
    }
    NUMBER turn[N], df[M];
    TYPED(set_time_direction)(dz, TYPED(broadcast)(1), dc);
    for (int a = 0; a < N; ++a)
        turn[a] = zero;
    for (int m = 0; m < M; ++m)
        df[m] = zero;
    TYPED(add_times)(N, N, &l->K[P][0][0], dq1, turn);
    TYPED(add_times)(N, E, &l->force_c[P][0][0], dc, turn);
    for (int a = 0; a < N; ++a)
        dp1[a] -= turn[a];
    TYPED(add_times)(M, N, &l->f_q[0][0], dq1, df);
    TYPED(add_times)(M, N, &l->f_p[0][0], dp1, df);
    TYPED(add_times)(M, E, &l->f_c[0][0], dc, df);
    TYPED(solve_with)(M, l->W, l->W_pivots, df);
    for (int a = 0; a < N; ++a)
        for (int m = 0; m < M; ++m)
            dp1[a] -= l->G[P][m][a]*df[m];
#endif
    for (int a = 0; a < N; ++a) {
        dz1[a] = dq1[a];
        dz1[N + a] = dp1[a];
    }
}

/* z <- the cotangent of (q, p, constants, t0, h) of the cotangent w of (q1, p1). */
static void TYPED(step_adjoint)(const TYPED(linearisation_t) *l, const NUMBER w[2*N], NUMBER z[Z])
{
    const NUMBER h = l->h, zero = TYPED(broadcast)(0);
    NUMBER x[U], q_end[N], p_end[N], by_c[E], by_h = zero;
    for (int e = 0; e < Z; ++e)
        z[e] = zero;
    for (int a = 0; a < N; ++a) {
        q_end[a] = w[a];
        p_end[a] = w[N + a];
    }
    for (int e = 0; e < E; ++e)
        by_c[e] = zero;
#if GS_CONSTRAINED
    NUMBER nu[M], minus[N], Q[P + 1][N], force[P][N];
    for (int m = 0; m < M; ++m)
        nu[m] = zero;
    TYPED(add_times)(M, N, &l->G[P][0][0], p_end, nu);
    TYPED(solve_transposed_with)(M, l->W, l->W_pivots, nu);
    for (int m = 0; m < M; ++m)
        nu[m] = -nu[m];
    TYPED(add_transposed)(M, N, &l->f_p[0][0], nu, p_end);
    TYPED(add_transposed)(M, N, &l->f_q[0][0], nu, q_end);
    TYPED(add_transposed)(M, E, &l->f_c[0][0], nu, by_c);
    for (int a = 0; a < N; ++a)
        minus[a] = -p_end[a];
    TYPED(add_transposed)(N, N, &l->K[P][0][0], minus, q_end);
    TYPED(add_transposed)(N, E, &l->force_c[P][0][0], minus, by_c);
    TYPED(add_time_cotangent)(by_c, TYPED(broadcast)(1), z);
    for (int k = 0; k < P; ++k) {
        for (int a = 0; a < N; ++a) {
            force[k][a] = -h*tableau.b_tilde[k]*p_end[a];
            Q[k][a] = zero;
        }
        TYPED(add_transposed)(N, N, &l->K[k][0][0], force[k], Q[k]);
        for (int m = 0; m < M; ++m)
            x[LAMBDA + k*M + m] = zero;
        TYPED(add_times)(M, N, &l->G[k][0][0], force[k], x + LAMBDA + k*M);
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
    TYPED(solve_transposed_with)(U, l->J, l->pivots, x);
    for (int a = 0; a < N; ++a) {
        z[a] += q_end[a];
        z[N + a] += p_end[a];
        by_h += l->node_rate[P][a]*q_end[a] + l->end_rate[a]*p_end[a];
    }
    for (int i = 0; i < S; ++i) {
        NUMBER force_bar[N], dq[N], dp[N];
        const NUMBER *velocity_bar = x + i*N; /* of -R': dx <- (velocity, -force) */
        for (int a = 0; a < N; ++a) {
            force_bar[a] = -x[K_HAT + i*N + a];
            dq[a] = dp[a] = zero;
        }
        for (int e = 0; e < E; ++e)
            by_c[e] = zero;
        TYPED(add_transposed)(N, N, &l->H_qq[i][0][0], force_bar, dq);
        TYPED(add_transposed)(N, N, &l->H_pq[i][0][0], velocity_bar, dq);
        TYPED(add_transposed)(N, N, &l->H_qp[i][0][0], force_bar, dp);
        TYPED(add_transposed)(N, N, &l->H_pp[i][0][0], velocity_bar, dp);
        TYPED(add_transposed)(N, E, &l->H_qc[i][0][0], force_bar, by_c);
        TYPED(add_transposed)(N, E, &l->H_pc[i][0][0], velocity_bar, by_c);
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
            TYPED(add_transposed)(N, N, &l->K[k][0][0], force[k], dQ);
            TYPED(add_transposed)(N, E, &l->force_c[k][0][0], force[k], by_c);
        }
        if (k > 0) {
            NUMBER g_bar[M];
            for (int m = 0; m < M; ++m)
                g_bar[m] = -x[LAMBDA + (k - 1)*M + m];
            TYPED(add_transposed)(M, N, &l->G[k][0][0], g_bar, dQ);
            TYPED(add_transposed)(M, E, &l->g_c[k][0][0], g_bar, by_c);
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
