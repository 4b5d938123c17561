/* Update of the rates, with Jacobi or Gauss-Seidel ordering, and projection of the momenta. */

/* Replaces the rates of item i by the new ones; accumulates the squared norm of the increment. */
INLINE void SOLVER(accumulate_increment)(SOLVER(t) *w, int i, const lanes *L_new,
    const lanes *H_q, lanes *q_change, lanes *p_change)
{
    lanes *L = w->now.x + i*N, *L_hat = w->now.x + SOLVER(HAT) + i*N;
    lanes dq_square = splat(0), dp_square = splat(0); /* per item: shorter dependency chains */
    for (int a = 0; a < N; ++a) {
        const lanes force = -w->h_b_hat[i]*H_q[a];
        const lanes dq = L_new[a] - L[a], dp = force - L_hat[a];
        if (a < MEASURED) {
            dq_square += dq*dq;
            dp_square += dp*dp;
        }
        L[a] = L_new[a];
        L_hat[a] = force;
    }
    *q_change += dq_square;
    *p_change += dp_square;
}

#if !GS_CONSTRAINED
#if GS_SEPARABLE
/*
 * Gauss-Seidel ordering: H_pq = 0, and H_q at the new positions squares the contraction factor of
 * the iteration.
 */
INLINE void SOLVER(update_rates)(SOLVER(t) *w, lanes *Q, lanes *momentum, lanes *L_new,
    lanes (*shared)[SHARED], lanes *q_change, lanes *p_change)
{
    SOLVER(stage_positions)(w, L_new, Q);
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes H_q[N], H_p[N];
        const lanes t = w->t + w->stage_time[i];
        second_rates(LANES_AT(&w->constants, t), Q + i*N, momentum + i*N, &t, shared[i], H_p, H_q);
        SOLVER(accumulate_increment)(w, i, L_new + i*N, H_q, q_change, p_change);
    }
}
#else
/* Jacobi ordering: H_q at the stages of the previous iteration. */
INLINE void SOLVER(update_rates)(SOLVER(t) *w, lanes *Q, lanes *momentum, lanes *L_new,
    lanes (*shared)[SHARED], lanes *q_change, lanes *p_change)
{
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes H_q[N], H_p[N];
        const lanes t = w->t + w->stage_time[i];
        second_rates(LANES_AT(&w->constants, t), Q + i*N, momentum + i*N, &t, shared[i], H_p, H_q);
        SOLVER(accumulate_increment)(w, i, L_new + i*N, H_q, q_change, p_change);
    }
}
#endif
#endif

#if GS_CONSTRAINED
#if GS_SCALAR_SCHUR
#if GS_SEPARABLE
/*
 * Gauss-Seidel ordering: H_pq = 0, and H_q at the new positions squares the contraction factor.
 * H_pp G^T = c G^T: the correction of the impulses changes H_p by c times the change of the
 * momenta, without another evaluation.
 */
INLINE void SOLVER(update_rates)(SOLVER(t) *w, lanes *Q, lanes *momentum, lanes *L_new,
    lanes (*shared)[SHARED], lanes *q_change, lanes *p_change)
{
    lanes C[SOLVER(S)*N];
    SOLVER(correct_multipliers)(w, L_new, C);
    for (int e = 0; e < SOLVER(S)*N; ++e)
        L_new[e] += w->h_b[e/N]*w->constraint_state.correction*(C[e] - w->now.C[e]);
    SOLVER(stage_positions)(w, L_new, Q);
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes H_q[N], H_p[N];
        for (int a = 0; a < N; ++a) {
            momentum[i*N + a] += C[i*N + a] - w->now.C[i*N + a];
            w->now.C[i*N + a] = C[i*N + a];
        }
        const lanes t = w->t + w->stage_time[i];
        second_rates(LANES_AT(&w->constants, t), Q + i*N, momentum + i*N, &t, shared[i], H_p, H_q);
        SOLVER(accumulate_increment)(w, i, L_new + i*N, H_q, q_change, p_change);
    }
}
#else
/*
 * Jacobi ordering. H_pp G^T = c G^T: the correction of the impulses changes H_p by c times the
 * change of the momenta, without another evaluation.
 */
INLINE void SOLVER(update_rates)(SOLVER(t) *w, lanes *Q, lanes *momentum, lanes *L_new,
    lanes (*shared)[SHARED], lanes *q_change, lanes *p_change)
{
    lanes C[SOLVER(S)*N];
    SOLVER(correct_multipliers)(w, L_new, C);
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes H_q[N], H_p[N], P[N], L[N]; /* in registers: stores are slower than additions */
        const lanes response = w->h_b[i]*w->constraint_state.correction;
        for (int a = 0; a < N; ++a) {
            const lanes force_change = C[i*N + a] - w->now.C[i*N + a];
            P[a] = momentum[i*N + a] + force_change;
            w->now.C[i*N + a] = C[i*N + a];
            L[a] = L_new[i*N + a] + response*force_change;
        }
        const lanes t = w->t + w->stage_time[i];
        second_rates(LANES_AT(&w->constants, t), Q + i*N, P, &t, shared[i], H_p, H_q);
        SOLVER(accumulate_increment)(w, i, L, H_q, q_change, p_change);
    }
}
#endif
#else
#if GS_SEPARABLE
/*
 * Gauss-Seidel ordering: H_pq = 0, and H_q at the new positions squares the contraction factor. The
 * new positions follow from H_p at the momenta of the corrected impulses.
 */
INLINE void SOLVER(update_rates)(SOLVER(t) *w, lanes *Q, lanes *momentum, lanes *L_new,
    lanes (*shared)[SHARED], lanes *q_change, lanes *p_change)
{
    lanes C[SOLVER(S)*N];
    SOLVER(correct_multipliers)(w, L_new, C);
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes H_q[N], H_p[N];
        for (int a = 0; a < N; ++a) {
            momentum[i*N + a] += C[i*N + a] - w->now.C[i*N + a];
            w->now.C[i*N + a] = C[i*N + a];
        }
        const lanes t = w->t + w->stage_time[i];
        second_rates(LANES_AT(&w->constants, t), Q + i*N, momentum + i*N, &t, shared[i], H_p, H_q);
        for (int a = 0; a < N; ++a)
            L_new[i*N + a] = w->h_b[i]*H_p[a];
    }
    SOLVER(stage_positions)(w, L_new, Q);
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes H_q[N], H_p[N];
        const lanes t = w->t + w->stage_time[i];
        second_rates(LANES_AT(&w->constants, t), Q + i*N, momentum + i*N, &t, shared[i], H_p, H_q);
        SOLVER(accumulate_increment)(w, i, L_new + i*N, H_q, q_change, p_change);
    }
}
#else
/* Jacobi ordering: H_p and H_q at the momenta of the corrected impulses. */
INLINE void SOLVER(update_rates)(SOLVER(t) *w, lanes *Q, lanes *momentum, lanes *L_new,
    lanes (*shared)[SHARED], lanes *q_change, lanes *p_change)
{
    lanes C[SOLVER(S)*N];
    SOLVER(correct_multipliers)(w, L_new, C);
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes H_q[N], H_p[N];
        for (int a = 0; a < N; ++a) {
            momentum[i*N + a] += C[i*N + a] - w->now.C[i*N + a];
            w->now.C[i*N + a] = C[i*N + a];
        }
        const lanes t = w->t + w->stage_time[i];
        second_rates(LANES_AT(&w->constants, t), Q + i*N, momentum + i*N, &t, shared[i], H_p, H_q);
        for (int a = 0; a < N; ++a)
            L_new[i*N + a] = w->h_b[i]*H_p[a];
        SOLVER(accumulate_increment)(w, i, L_new + i*N, H_q, q_change, p_change);
    }
}
#endif
#endif

#if GS_ELEMENTS
/*
 * T2: projects dp so that p + dp satisfies the hidden constraint f(q, p) = 0. The impulses of the
 * projection are stored as last_impulse.
 */
INLINE void SOLVER(project_momentum_increment)(SOLVER(t) *w, const lanes q[N], lanes dp[N])
{
    for (int mu = 0; mu < M; ++mu)
        w->constraint_state.last_impulse[mu] = splat(0);
    for (int iteration = 0; iteration < ROUNDS; ++iteration) {
        lanes f[M], p[N], response[N];
        schur_t matrix;
        for (int a = 0; a < N; ++a)
            p[a] = w->p[a] + dp[a];
        lanes_hidden_constraint(&w->constants, q, p, f);
        lanes_schur(&w->constants, q, p, matrix);
        lanes_factor(matrix);
        lanes_substitute(matrix, f);
        lanes_constraint_force(&w->constants, q, f, response);
        for (int mu = 0; mu < M; ++mu)
            w->constraint_state.last_impulse[mu] += f[mu];
        for (int a = 0; a < N; ++a)
            dp[a] -= response[a];
    }
}
#else
/*
 * T2: projects dp so that p + dp satisfies the hidden constraint f(q, p) = 0. The impulses of the
 * projection are stored as last_impulse.
 */
INLINE void SOLVER(project_momentum_increment)(SOLVER(t) *w, const lanes q[N], lanes dp[N])
{
    lanes G[M][N];
    lanes_constraint_jacobian(&w->constants, q, G);
    for (int mu = 0; mu < M; ++mu)
        w->constraint_state.last_impulse[mu] = splat(0);
    for (int iteration = 0; iteration < ROUNDS; ++iteration) {
        lanes f[M], p[N];
        schur_t matrix;
        for (int a = 0; a < N; ++a)
            p[a] = w->p[a] + dp[a];
        lanes_hidden_constraint(&w->constants, q, p, f);
        lanes_hidden_matrix(&w->constants, q, p, matrix);
        lanes_factor(matrix);
        lanes_substitute(matrix, f);
        for (int mu = 0; mu < M; ++mu) {
            w->constraint_state.last_impulse[mu] += f[mu];
            for (int a = 0; a < N; ++a)
                dp[a] -= G[mu][a]*f[mu];
        }
    }
}
#endif
#endif
