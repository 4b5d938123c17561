/* D_p = (v0 + v1)/2 and D_q - F = -R, exact between the ends: H(q1, p1) - H(q0, p0) is theirs */
static void mean_gradient(const constants *c, const real qm[N], const real pm[N],
    const real dq[N], const real dp[N], const real t[1], real D_q[N], real D_p[N])
{
    real q1[N], A[MASS], v0[N], v1[N];
    ends(c, qm, pm, dq, dp, q1, A, v0, v1);
    mean_push(c, qm, dq, v0, v1, t, D_q);
    for (int a = 0; a < N; ++a) {
        D_q[a] = -D_q[a];
        D_p[a] = (v0[a] + v1[a])/2;
    }
}

/*
 * Their derivatives by dq and dp, where the end moves: with P = d(b + M v)/dq there,
 * dv1 = M^-1 (dp - P dq), and of R those by q1 and v1.
 */
static void mean_jacobian(const constants *c, const real qm[N], const real pm[N],
    const real dq[N], const real dp[N], const real t[1], real D_qq[N][N], real D_qp[N][N],
    real D_pq[N][N], real D_pp[N][N])
{
    const real zero[N] = { 0 };
    real q1[N], A[MASS], v0[N], v1[N], way[N] = { 0 }, P[N][N], R_v[N][N], change[N];
    const constants *later = c;
    TIMED(constants end = *c;)
    TIMED(later = at_time(&end, c->_t + c->_late/2);)
    ends(c, qm, pm, dq, dp, q1, A, v0, v1);
    for (int b = 0; b < N; ++b) {
        way[b] = 1;
        slope_change(later, q1, v1, zero, way, P[b]);
        mean_push_change(c, qm, dq, v0, v1, t, zero, way, change);
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
        mean_push_change(c, qm, dq, v0, v1, t, way, by_q, change);
        for (int a = 0; a < N; ++a) {
            real sum = 0;
            for (int b = 0; b < N; ++b)
                sum += R_v[a][b]*by_p[b];
            D_pq[a][column] = by_q[a]/2;
            D_pp[a][column] = by_p[a]/2;
            D_qq[a][column] = -change[a];
            D_qp[a][column] = -sum;
        }
        way[column] = 0;
    }
}
