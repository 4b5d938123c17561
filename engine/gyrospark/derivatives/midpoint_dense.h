/*
 * Implicit midpoint (IMS) and energy-momentum (EMS) schemes: the linearisation of a step of a system
 * that is written out in full, on numbers or lanes, as matrices.
 */

/* What derivatives of one step are made of. */
typedef struct {
    NUMBER h, x[U];
    /* Derivatives of D_q - F + G^T lambda and D_p at fixed x, by start and constants. */
    NUMBER D_qq[N][N], D_qp[N][N], D_pq[N][N], D_pp[N][N], D_qc[N][E], D_pc[N][E];
#if GS_CONSTRAINED
    NUMBER G[M][N], g_c[M][E]; /* at the end of the step */
#endif
    NUMBER J[U*U];
    TYPED(pivots_t) pivots[2*U];
} TYPED(linearisation_t);

/*
 * Linearises the step from (q, p) with the unknowns x to (q1, p1), which starts at t. `c` are the
 * constants, in which the time may be set.
 */
static int TYPED(linearise)(TYPED(constants) *c, NUMBER t, NUMBER h, const NUMBER q[N],
    const NUMBER p[N], const NUMBER x[U], const NUMBER q1[N], const NUMBER p1[N],
    TYPED(linearisation_t) *l)
{
    NUMBER qm[N], pm[N], D_qq[N][N], D_qp[N][N], D_pq[N][N], D_pp[N][N];
    const NUMBER zero = TYPED(broadcast)(0), middle = t + h/2, rate = 1/h;
    const TYPED(constants) *at = TYPED_BETWEEN(c, t, h);
    (void)q1, (void)p1;
    l->h = h;
    for (int e = 0; e < U; ++e)
        l->x[e] = x[e];
    for (int a = 0; a < N; ++a) {
        qm[a] = q[a] + x[a]/2;
        pm[a] = p[a] + x[DP + a]/2;
    }
    TYPED(mean_jacobian)(at, qm, pm, x, x + DP, &middle, D_qq, D_qp, D_pq, D_pp);
    TYPED(mean_rates_derivative)(at, qm, pm, x, x + DP, &middle, l->D_qq, l->D_qp, l->D_pq,
        l->D_pp, l->D_qc, l->D_pc);
    NUMBER *J = l->J;
    for (int e = 0; e < U*U; ++e)
        J[e] = zero;
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b) {
            const NUMBER own = a == b ? rate : zero;
            J[a*U + b] = own - D_pq[a][b];
            J[a*U + DP + b] = -D_pp[a][b];
            J[(DP + a)*U + b] = D_qq[a][b];
            J[(DP + a)*U + DP + b] = own + D_qp[a][b];
        }
#if GS_CONSTRAINED
    NUMBER K[N][N], mean_G[M][N], force_c[N][E];
    TYPED(mean_curvature)(at, qm, x, x + LAMBDA, K);
    TYPED(mean_constraint)(at, qm, x, mean_G);
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b)
            J[(DP + a)*U + b] += K[a][b];
    TYPED(mean_constraint_by_start)(at, qm, x, x + LAMBDA, K, force_c);
    for (int a = 0; a < N; ++a) {
        for (int b = 0; b < N; ++b)
            l->D_qq[a][b] += K[a][b];
        for (int e = 0; e < E; ++e)
            l->D_qc[a][e] += force_c[a][e];
    }
    at = TYPED_AT(c, t + h);
    TYPED(constraint_jacobian)(at, q1, l->G);
    TYPED(constraint_by_constants)(at, q1, l->g_c);
    for (int m = 0; m < M; ++m)
        for (int a = 0; a < N; ++a) {
            J[(DP + a)*U + LAMBDA + m] = mean_G[m][a];
            J[(LAMBDA + m)*U + a] = l->G[m][a];
        }
#endif
    return TYPED(factorise_matrix)(U, J, l->pivots);
}

/* (force, velocity) += the derivative of (D_q - F + G^T lambda, D_p) along (dq, dp, dc) of the start */
static inline void TYPED(mean_times)(const TYPED(linearisation_t) *l, const NUMBER dq[N],
    const NUMBER dp[N], const NUMBER dc[E], NUMBER force[N], NUMBER velocity[N])
{
    TYPED(add_times)(N, N, &l->D_qq[0][0], dq, force);
    TYPED(add_times)(N, N, &l->D_qp[0][0], dp, force);
    TYPED(add_times)(N, E, &l->D_qc[0][0], dc, force);
    TYPED(add_times)(N, N, &l->D_pq[0][0], dq, velocity);
    TYPED(add_times)(N, N, &l->D_pp[0][0], dp, velocity);
    TYPED(add_times)(N, E, &l->D_pc[0][0], dc, velocity);
}

/* The transpose of mean_times, added to (q, p, c) */
static inline void TYPED(mean_transposed)(const TYPED(linearisation_t) *l, const NUMBER force[N],
    const NUMBER velocity[N], NUMBER q[N], NUMBER p[N], NUMBER c[E])
{
    TYPED(add_transposed)(N, N, &l->D_qq[0][0], force, q);
    TYPED(add_transposed)(N, N, &l->D_pq[0][0], velocity, q);
    TYPED(add_transposed)(N, N, &l->D_qp[0][0], force, p);
    TYPED(add_transposed)(N, N, &l->D_pp[0][0], velocity, p);
    TYPED(add_transposed)(N, E, &l->D_qc[0][0], force, c);
    TYPED(add_transposed)(N, E, &l->D_pc[0][0], velocity, c);
}

#if GS_CONSTRAINED
/* dg += G dq + g_c dc at the end of the step */
static inline void TYPED(constraint_times)(const TYPED(linearisation_t) *l, int k,
    const NUMBER dq[N], const NUMBER dc[E], NUMBER dg[M])
{
    (void)k;
    TYPED(add_times)(M, N, &l->G[0][0], dq, dg);
    TYPED(add_times)(M, E, &l->g_c[0][0], dc, dg);
}

/* q += G^T g, c += g_c^T g */
static inline void TYPED(constraint_transposed)(const TYPED(linearisation_t) *l, int k,
    const NUMBER g[M], NUMBER q[N], NUMBER c[E])
{
    (void)k;
    TYPED(add_transposed)(M, N, &l->G[0][0], g, q);
    TYPED(add_transposed)(M, E, &l->g_c[0][0], g, c);
}
#endif
