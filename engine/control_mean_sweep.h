/*
 * One sweep, Gauss-Seidel: dq from dp, the impulses from the constraint at the end, both corrected,
 * dp from them. Returns the sum of squares of what it changed, relative to the state.
 */
static real sweep(state_t *w)
{
    real x[X], G[ROOM][N], force[N], q_change = 0, p_change = 0;
    for (int e = 0; e < X; ++e)
        x[e] = w->x[e];
    move(w, x);
    constrain(w, x, G);
    kick(w, x, force);
    hold(G, x + IMPULSE, force);
    for (int a = 0; a < N; ++a) {
        x[HAT + a] = force[a];
        q_change += (x[a] - w->x[a])*(x[a] - w->x[a]);
        p_change += (force[a] - w->x[HAT + a])*(force[a] - w->x[HAT + a]);
    }
    for (int e = 0; e < X; ++e)
        w->x[e] = x[e];
    return q_change*w->q_size + p_change*w->p_size;
}

/* The end of the step, `low` what rounding leaves over. */
static void end_of_step(const state_t *w, real q[N], real p[N], real q_low[N], real p_low[N])
{
    real dq[N], dp[N];
    for (int a = 0; a < N; ++a) {
        dq[a] = w->x[a] + w->q_low[a];
        dp[a] = w->x[HAT + a] + w->p_low[a];
    }
    move_on(w->q, dq, q, q_low);
    move_on(w->p, dp, p, p_low);
}
