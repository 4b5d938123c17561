/*
 * Of L at the v of a state: P = d(b + M v)/dq, which is the transpose of d(dL/dq)/dv, and with
 * M dv = -P dq along which p stays: H_pp = M^-1, H_pq = -M^-1 P, and of R = dL/dq + F the
 * derivatives H_qq = -(R_q + R_v H_pq), H_qp = -R_v H_pp of H_q - F.
 */
static void rates_by_state(const constants *c, const real q[N], const real p[N], const real t[1],
    real H_qq[N][N], real H_qp[N][N], real H_pq[N][N], real H_pp[N][N])
{
    const real zero[N] = { 0 };
    real A[MASS], v[N], way[N] = { 0 }, P[N][N], R_v[N][N], change[N];
    factor_mass(c, q, A);
    velocities(c, q, p, A, v);
    for (int b = 0; b < N; ++b) {
        way[b] = 1;
        slope_change(c, q, v, zero, way, P[b]);
        for (int a = 0; a < N; ++a)
            change[a] = P[b][a];
        add_force_change(c, q, v, t, zero, way, change);
        for (int a = 0; a < N; ++a)
            R_v[a][b] = change[a];
        way[b] = 0;
    }
    for (int column = 0; column < N; ++column) {
        real by_p[N] = { 0 }, by_q[N];
        way[column] = by_p[column] = 1;
        solve_mass(A, by_p);
        for (int a = 0; a < N; ++a)
            by_q[a] = -P[a][column];
        solve_mass(A, by_q);
        slope_change(c, q, v, way, by_q, change);
        add_force_change(c, q, v, t, way, by_q, change);
        for (int a = 0; a < N; ++a) {
            real sum = 0;
            for (int b = 0; b < N; ++b)
                sum += R_v[a][b]*by_p[b];
            H_pq[a][column] = by_q[a];
            H_pp[a][column] = by_p[a];
            H_qq[a][column] = -change[a];
            H_qp[a][column] = -sum;
        }
        way[column] = 0;
    }
}
