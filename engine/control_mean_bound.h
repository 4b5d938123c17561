/*
 * Corrects the impulses, so that the end is on the constraints, and both increments with them;
 * w->defect is how far from g = 0 the end was before. G is that between the ends.
 */
static void constrain(state_t *w, real x[X], real G[ROOM][N])
{
    real q_mean[N], p_mean[N], g[M], old[M];
    means(w, x, q_mean, p_mean);
    ON(mean_constraint)(&w->constants, q_mean, x, G);
    ON(constraint_increment)(&w->constants, w->q, x, g);
    w->defect = 0;
    for (int mu = 0; mu < M; ++mu) {
        g[mu] += w->g[mu];
        w->defect += g[mu]*g[mu]*w->shortness[mu]*w->q_size;
        old[mu] = x[IMPULSE + mu];
    }
    correct(w, g, x + IMPULSE);
    for (int mu = 0; mu < M; ++mu)
        for (int a = 0; a < N; ++a)
            respond(w, a, G[mu][a]*(x[IMPULSE + mu] - old[mu]), x);
    move_again(w, x);
}

/* force -= G^T impulse */
static void hold(real G[ROOM][N], const real *impulse, real force[N])
{
    for (int a = 0; a < N; ++a)
        for (int mu = 0; mu < M; ++mu)
            force[a] -= G[mu][a]*impulse[mu];
}
