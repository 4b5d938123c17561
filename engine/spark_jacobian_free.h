/*
 * dr/dx at the stage values of the last residual, without constraints:
 *   d(k_i row)/dk_j = delta - dt a_ij H_pq,   d/dk^_j = -dt a^_ij H_pp,
 *   d(k^_i row)/dk_j = dt a_ij H_qq,          d/dk^_j = delta + dt a^_ij H_qp
 */
static void jacobian(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real J[U*U])
{
    (void)q, (void)p, (void)x;
    for (int i = 0; i < S; ++i) {
        real H_qq[N][N], H_qp[N][N], H_pq[N][N], H_pp[N][N];
        const real t = w->t + dt*tableau.c[i];
        rates_by_state(AT(&w->constants,
            t), w->stage_q[i], w->stage_p[i], &t, H_qq, H_qp, H_pq, H_pp);
        for (int j = 0; j < S; ++j) {
            const real a_ij = dt*tableau.A[i][j], a_hat = dt*tableau.A_hat[i][j];
            for (int a = 0; a < N; ++a) {
                real *upper = J + (i*N + a)*U, *lower = J + (K_HAT + i*N + a)*U;
                for (int b = 0; b < N; ++b) {
                    const real one = i == j && a == b ? 1 : 0;
                    upper[j*N + b] = one - a_ij*H_pq[a][b];
                    upper[K_HAT + j*N + b] = -a_hat*H_pp[a][b];
                    lower[j*N + b] = a_ij*H_qq[a][b];
                    lower[K_HAT + j*N + b] = one + a_hat*H_qp[a][b];
                }
            }
        }
    }
}
