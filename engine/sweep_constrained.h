/*
 * C_i = p + sum_j nu~_ij Y_j with Y_j = -G(Q~_j)^T (impulse j) at the nodes, which are at
 * Q~_l = q + D_l, D_l = sum_j nu_lj L_j
 */
INLINE void RUN(forces)(RUN(t) *w, lanes *C)
{
    const lanes *impulse = w->now.x + RUN(IMPULSE);
    for (int j = 0; j < RUN(P); ++j) {
        lanes place[N], *Y = w->now.Y + j*N;
        RUN(node)(w, j, place);
        lanes_constraint_force(LANES_AT(&w->constants,
            w->t + w->act[j]*w->span), place, impulse + j*M, Y);
        for (int a = 0; a < N; ++a)
            Y[a] = -Y[a];
    }
    RUN(pulls)(w, w->now.Y, C);
}

/* From starting values: the places of the nodes and the constraint forces there. */
INLINE void RUN(begin)(RUN(t) *w)
{
    RUN(displace)(w, w->now.x, w->now.D);
    RUN(forces)(w, w->now.C);
    RUN(factor)(w);
}

/* P_i = C_i + sum_j mu^_ij L^_j */
INLINE void RUN(momenta)(const RUN(t) *w, const lanes *L_hat, lanes *momentum)
{
    RUN(pushes)(w, w->now.C, N, L_hat, momentum);
}

/*
 * Corrects the impulses, so that places that L leads to are on the constraints; C are their forces.
 * w->bound.defect is how far from g = 0 the nodes were before.
 */
INLINE void RUN(constrain)(RUN(t) *w, const lanes *L, lanes *C)
{
    lanes g[RUN(P)*M], defect[RUN(P)*M];
    RUN(displace)(w, L, w->now.D);
    for (int l = 0; l < RUN(P); ++l) {
        lanes increment[M];
        lanes_constraint_increment(LANES_BETWEEN(&w->constants,
            w->t, w->ask[l]*w->span), w->q, w->now.D + l*N, increment);
        for (int mu = 0; mu < M; ++mu)
            g[l*M + mu] = w->bound.g[mu] + increment[mu];
    }
    w->bound.defect = splat(0);
    for (int mu = 0; mu < M; ++mu) {
        lanes square = splat(0);
        for (int l = 0; l < RUN(P); ++l)
            square += g[l*M + mu]*g[l*M + mu];
        w->bound.defect += square*w->bound.shortness[mu];
    }
    w->bound.defect *= w->q_size;
    RUN(nodes_of_nodes)(w->zero, 0, TABLE(inverse), g, defect);
    RUN(correct)(w, defect, w->now.x + RUN(IMPULSE));
    RUN(forces)(w, C);
}

/* dp += what the impulses did, and what rounding left of the last step */
INLINE void RUN(add_impulses)(const RUN(t) *w, lanes dp[N])
{
    lanes impulse[N];
    RUN(total)(P, N, w->now.Y, impulse);
    for (int a = 0; a < N; ++a)
        dp[a] += impulse[a] + w->p_low[a];
}

/* The polynomial through the last impulses, one step on. */
INLINE void RUN(continue_nodes)(const RUN(t) *w, const lanes *values, lanes *through)
{
    RUN(nodes_of_nodes)(w->zero, 0, TABLE(onward_nodes), values, through);
}
