/*
 * Implicit midpoint (IMS) and energy-momentum (EMS) schemes: the linearised equations of a step and
 * their transpose, on numbers or lanes. x = (dq, dp, lambda), q1 = q + dq, p1 = p + dp; at fixed x
 * the start moves the mean values.
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
    return TYPED(factorise)(U, J, l->pivots);
}

/* dz1 <- the derivative of (q1, p1) along dz: rows q, p, constants, t0, h. */
static void TYPED(step_tangent)(const TYPED(linearisation_t) *l, const NUMBER dz[Z],
    NUMBER dz1[2*N])
{
    const NUMBER zero = TYPED(broadcast)(0), squared = l->h*l->h;
    NUMBER dx[U], dc[E], velocity[N], force[N];
    for (int a = 0; a < N; ++a)
        velocity[a] = force[a] = zero;
    TYPED(set_time_direction)(dz, TYPED(broadcast)((real)0.5), dc);
    TYPED(add_times)(N, N, &l->D_qq[0][0], dz, force);
    TYPED(add_times)(N, N, &l->D_qp[0][0], dz + N, force);
    TYPED(add_times)(N, E, &l->D_qc[0][0], dc, force);
    TYPED(add_times)(N, N, &l->D_pq[0][0], dz, velocity);
    TYPED(add_times)(N, N, &l->D_pp[0][0], dz + N, velocity);
    TYPED(add_times)(N, E, &l->D_pc[0][0], dc, velocity);
    for (int a = 0; a < N; ++a) { /* r = dq/h - D_p, dp/h + D_q */
        dx[a] = velocity[a] + l->x[a]/squared*dz[DH];
        dx[DP + a] = l->x[DP + a]/squared*dz[DH] - force[a];
    }
#if GS_CONSTRAINED
    NUMBER dg[M];
    for (int m = 0; m < M; ++m)
        dg[m] = zero;
    TYPED(set_time_direction)(dz, TYPED(broadcast)(1), dc);
    TYPED(add_times)(M, N, &l->G[0][0], dz, dg);
    TYPED(add_times)(M, E, &l->g_c[0][0], dc, dg);
    for (int m = 0; m < M; ++m)
        dx[LAMBDA + m] = -dg[m];
#endif
    TYPED(solve_with)(U, l->J, l->pivots, dx);
    for (int a = 0; a < 2*N; ++a)
        dz1[a] = dz[a] + dx[a];
}

/* z <- the cotangent of (q, p, constants, t0, h) of the cotangent w of (q1, p1). */
static void TYPED(step_adjoint)(const TYPED(linearisation_t) *l, const NUMBER w[2*N], NUMBER z[Z])
{
    const NUMBER zero = TYPED(broadcast)(0), squared = l->h*l->h;
    NUMBER x[U], by_c[E], force_bar[N];
    for (int e = 0; e < Z; ++e)
        z[e] = e < 2*N ? w[e] : zero;
    for (int e = 0; e < U; ++e)
        x[e] = e < 2*N ? w[e] : zero;
    for (int e = 0; e < E; ++e)
        by_c[e] = zero;
    TYPED(solve_transposed_with)(U, l->J, l->pivots, x);
    for (int a = 0; a < N; ++a) {
        force_bar[a] = -x[DP + a];
        z[DH] += (l->x[a]*x[a] + l->x[DP + a]*x[DP + a])/squared;
    }
    TYPED(add_transposed)(N, N, &l->D_qq[0][0], force_bar, z);
    TYPED(add_transposed)(N, N, &l->D_qp[0][0], force_bar, z + N);
    TYPED(add_transposed)(N, E, &l->D_qc[0][0], force_bar, by_c);
    TYPED(add_transposed)(N, N, &l->D_pq[0][0], x, z);
    TYPED(add_transposed)(N, N, &l->D_pp[0][0], x, z + N);
    TYPED(add_transposed)(N, E, &l->D_pc[0][0], x, by_c);
    TYPED(add_time_cotangent)(by_c, TYPED(broadcast)((real)0.5), z);
#if GS_CONSTRAINED
    NUMBER g_bar[M];
    for (int m = 0; m < M; ++m)
        g_bar[m] = -x[LAMBDA + m];
    for (int e = 0; e < E; ++e)
        by_c[e] = zero;
    TYPED(add_transposed)(M, N, &l->G[0][0], g_bar, z);
    TYPED(add_transposed)(M, E, &l->g_c[0][0], g_bar, by_c);
#if TIMES > 1
    by_c[E - 1] = zero; /* g at the end of the step depends on one time only */
#endif
    TYPED(add_time_cotangent)(by_c, TYPED(broadcast)(1), z);
#endif
}
