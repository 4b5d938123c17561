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

#if GS_CONSTRAINED
/*
 * P, L <- the momenta and rates of item i, at positions Q, corrected by the change of the impulses'
 * forces to C. With H_pp G^T = c G^T, L changes by h b c times as much; otherwise H_p is evaluated
 * again, and H_q with it. Results apart from their sources stay in registers, which saves a tenth.
 */
INLINE void SOLVER(correct_item)(SOLVER(t) *w, int i, const lanes *C, const lanes *Q,
    const lanes *momentum, const lanes *L_new, lanes *P, lanes *L, lanes *shared, lanes *H_q)
{
#if GS_SCALAR_SCHUR
    const lanes response = w->h_b[i]*w->constraint_state.correction;
    (void)Q, (void)shared, (void)H_q;
    for (int a = 0; a < N; ++a) {
        const lanes force_change = C[a] - w->now.C[i*N + a];
        P[a] = momentum[a] + force_change;
        w->now.C[i*N + a] = C[a];
        L[a] = L_new[a] + response*force_change;
    }
#else
    lanes H_p[N];
    const lanes t = w->t + w->stage_time[i];
    (void)L_new;
    for (int a = 0; a < N; ++a) {
        P[a] = momentum[a] + (C[a] - w->now.C[i*N + a]);
        w->now.C[i*N + a] = C[a];
    }
    second_rates(LANES_AT(&w->constants, t), Q, P, &t, shared, H_p, H_q);
    for (int a = 0; a < N; ++a)
        L[a] = w->h_b[i]*H_p[a];
#endif
}
#endif

/*
 * The new rates, with the impulses corrected. Gauss-Seidel ordering where H_pq = 0: H_q at the new
 * positions, which squares the contraction factor. Otherwise Jacobi ordering: H_q at the positions
 * of H_p.
 */
INLINE void SOLVER(update_rates)(SOLVER(t) *w, lanes *Q, lanes *momentum, lanes *L_new,
    lanes (*shared)[SHARED], lanes *q_change, lanes *p_change)
{
#if GS_CONSTRAINED
    lanes C[SOLVER(S)*N];
    SOLVER(correct_multipliers)(w, L_new, C);
#if GS_SEPARABLE
    lanes force[N];
    for (int i = 0; i < SOLVER(S); ++i)
        SOLVER(correct_item)(w, i, C + i*N, Q + i*N, momentum + i*N, L_new + i*N,
            momentum + i*N, L_new + i*N, shared[i], force);
#endif
#endif
#if GS_SEPARABLE
    SOLVER(stage_positions)(w, L_new, Q);
#endif
    for (int i = 0; i < SOLVER(S); ++i) {
        lanes H_q[N], P[N], L[N]; /* in registers: stores are slower than additions */
#if GS_CONSTRAINED && !GS_SEPARABLE
        SOLVER(correct_item)(w, i, C + i*N, Q + i*N, momentum + i*N, L_new + i*N, P, L, shared[i],
            H_q);
#else
        for (int a = 0; a < N; ++a) {
            P[a] = momentum[i*N + a];
            L[a] = L_new[i*N + a];
        }
#endif
#if !GS_CONSTRAINED || GS_SEPARABLE || GS_SCALAR_SCHUR
        lanes H_p[N];
        const lanes t = w->t + w->stage_time[i];
        second_rates(LANES_AT(&w->constants, t), Q + i*N, P, &t, shared[i], H_p, H_q);
#endif
        SOLVER(accumulate_increment)(w, i, L, H_q, q_change, p_change);
    }
}

#if GS_CONSTRAINED
/*
 * T2: projects dp so that p + dp satisfies the hidden constraint f(q, p) = 0. The impulses of the
 * projection are stored as last_impulse.
 */
INLINE void SOLVER(project_momentum_increment)(SOLVER(t) *w, const lanes q[N], lanes dp[N])
{
#if !GS_ELEMENTS
    lanes G[M][N];
    lanes_constraint_jacobian(&w->constants, q, G);
#endif
    for (int mu = 0; mu < M; ++mu)
        w->constraint_state.last_impulse[mu] = splat(0);
    for (int iteration = 0; iteration < ROUNDS; ++iteration) {
        lanes f[M], p[N];
        schur_t matrix;
        for (int a = 0; a < N; ++a)
            p[a] = w->p[a] + dp[a];
        lanes_hidden_constraint(&w->constants, q, p, f);
#if GS_ELEMENTS
        lanes response[N];
        lanes_schur(&w->constants, q, p, matrix);
        lanes_factor(matrix);
        lanes_substitute(matrix, f);
        lanes_constraint_force(&w->constants, q, f, response);
        for (int a = 0; a < N; ++a)
            dp[a] -= response[a];
        for (int mu = 0; mu < M; ++mu)
            w->constraint_state.last_impulse[mu] += f[mu];
#else
        lanes_hidden_matrix(&w->constants, q, p, matrix);
        lanes_factor(matrix);
        lanes_substitute(matrix, f);
        for (int mu = 0; mu < M; ++mu) {
            w->constraint_state.last_impulse[mu] += f[mu];
            for (int a = 0; a < N; ++a)
                dp[a] -= G[mu][a]*f[mu];
        }
#endif
    }
}
#endif
