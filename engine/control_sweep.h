/*
 * One sweep: new rates k_i = H_p and k^_i = -H_q of all stages, with the impulses corrected in
 * between. Returns the sum of squares of what it changed, relative to the state.
 */
static real sweep(state_t *w)
{
    real Q[S*N], momentum[S*N], L[S*N], shared[S][SHARED], q_change = 0, p_change = 0;
    combine(S, S, N, w->q, 0, &table_mu[0][0], w->x, Q);
    combine(S, S, N, w->C, N, &table_mu_hat[0][0], w->x + HAT, momentum);
    for (int i = 0; i < S; ++i) {
        real H_p[N];
        first_rates(&w->constants, Q + i*N, momentum + i*N, H_p, shared[i]);
        for (int a = 0; a < N; ++a)
            L[i*N + a] = w->h*weights[i]*H_p[a];
    }
    respond(w, Q, momentum, L);
    follow(w, L, Q);
    for (int i = 0; i < S; ++i) {
        const real t = w->t + w->h*nodes[i];
        real H_q[N];
        second_rates(&w->constants, Q + i*N, momentum + i*N, &t, shared[i], H_q);
        for (int a = 0; a < N; ++a) {
            const int e = i*N + a;
            const real force = -(w->h*weights_hat[i])*H_q[a];
            q_change += (L[e] - w->x[e])*(L[e] - w->x[e]);
            p_change += (force - w->x[HAT + e])*(force - w->x[HAT + e]);
            w->x[e] = L[e];
            w->x[HAT + e] = force;
        }
    }
    return q_change*w->q_size + p_change*w->p_size;
}

/* T2: the end of the step from the converged stages, `low` what rounding leaves over. */
static void end_of_step(const state_t *w, real q[N], real p[N], real q_low[N], real p_low[N])
{
    real dq[N], dp[N];
    total(S, w->x, dq);
    total(S, w->x + HAT, dp);
    for (int a = 0; a < N; ++a)
        dq[a] += w->q_low[a];
    move_on(w->q, dq, q, q_low);
    land(w, q, dp);
    move_on(w->p, dp, p, p_low);
}
