/*
 * SPARK methods: the rows of J = dr/dx of (B.1), on numbers, lanes or dual numbers. With
 * K_l = d(G_l^T Lambda_l)/dQ~_l and dP_i/dk_j = B_ij = -h^2 sum_l a~_il a-_lj K_l:
 *   d(k_i row)/dk_j = delta - h a_ij H_pq - H_pp B_ij,   d/dk^_j = -h a^_ij H_pp,
 *   d(k^_i row)/dk_j = h a_ij H_qq + H_qp B_ij,          d/dk^_j = delta + h a^_ij H_qp,
 * and d/dLambda_l is H_pp and H_qp times -h a~_il G_l^T in place of B_ij.
 */

#if !GS_LAGRANGIAN
/* Derivatives of H_q - F and H_p. H_qp is the transpose of H_pq but for forces. */
static inline void TYPED(rates_by_state)(const TYPED(constants) *c, const NUMBER q[N],
    const NUMBER p[N], const NUMBER t[1], NUMBER H_qq[N][N], NUMBER H_qp[N][N], NUMBER H_pq[N][N],
    NUMBER H_pp[N][N])
{
#if GS_FORCES
    TYPED(hessian)(c, q, p, t, H_qq, H_qp, H_pq, H_pp);
#else
    TYPED(hessian)(c, q, p, t, H_qq, H_pq, H_pp);
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b)
            H_qp[a][b] = H_pq[b][a];
#endif
}
#endif

#if GS_SPARK
#include "gyrospark/spark/coefficients.h"
#include "gyrospark/spark/unknowns.h"

/* Sets the rows of k_i and k^_i from the derivatives at stage i, and G and K of the nodes. */
static inline void TYPED(fill_stage_rows)(const real *theta, NUMBER h, int i, NUMBER H_qq[N][N],
    NUMBER H_qp[N][N], NUMBER H_pq[N][N], NUMBER H_pp[N][N], IF_CONSTRAINED(NUMBER G[][M][N],
    NUMBER K[][N][N],) NUMBER J[U*U])
{
    const NUMBER zero = { 0 }, unit = zero + (real)1;
    (void)theta;
    for (int j = 0; j < S; ++j) {
        const NUMBER a_ij = h*A_STAGE(theta, i, j), a_hat = h*A_HAT(theta, i, j);
#if GS_CONSTRAINED
        NUMBER B[N][N];
        for (int a = 0; a < N; ++a)
            for (int b = 0; b < N; ++b) {
                NUMBER sum = zero;
                for (int l = 0; l < P; ++l)
                    sum += A_TILDE(theta, i, l)*A_BAR(theta, l, j)*K[l][a][b];
                B[a][b] = -h*h*sum;
            }
#endif
        for (int a = 0; a < N; ++a) {
            NUMBER *upper = J + (i*N + a)*U, *lower = J + (K_HAT + i*N + a)*U;
            for (int b = 0; b < N; ++b) {
                const NUMBER one = i == j && a == b ? unit : zero;
                NUMBER by_k = a_ij*H_pq[a][b], by_k_lower = a_ij*H_qq[a][b];
#if GS_CONSTRAINED
                for (int e = 0; e < N; ++e) {
                    by_k += H_pp[a][e]*B[e][b];
                    by_k_lower += H_qp[a][e]*B[e][b];
                }
#endif
                upper[j*N + b] = one - by_k;
                upper[K_HAT + j*N + b] = -a_hat*H_pp[a][b];
                lower[j*N + b] = by_k_lower;
                lower[K_HAT + j*N + b] = one + a_hat*H_qp[a][b];
            }
        }
    }
#if GS_CONSTRAINED
    for (int l = 0; l < P; ++l)
        for (int mu = 0; mu < M; ++mu)
            for (int a = 0; a < N; ++a) {
                const int column = LAMBDA + l*M + mu;
                NUMBER by_p = zero, by_p_lower = zero;
                for (int e = 0; e < N; ++e) {
                    by_p += H_pp[a][e]*G[l][mu][e];
                    by_p_lower += H_qp[a][e]*G[l][mu][e];
                }
                const NUMBER a_tilde = h*A_TILDE(theta, i, l);
                J[(i*N + a)*U + column] = a_tilde*by_p;
                J[(K_HAT + i*N + a)*U + column] = -a_tilde*by_p_lower;
            }
#endif
}

#if GS_CONSTRAINED
/* Sets the rows of g(Q~_l), l = 1..P. */
static inline void TYPED(fill_node_rows)(const real *theta, NUMBER h, NUMBER G[][M][N],
    NUMBER J[U*U])
{
    (void)theta;
    for (int l = 1; l <= P; ++l)
        for (int mu = 0; mu < M; ++mu)
            for (int j = 0; j < S; ++j)
                for (int b = 0; b < N; ++b)
                    J[(LAMBDA + (l - 1)*M + mu)*U + j*N + b] = h*A_BAR(theta, l, j)*G[l][mu][b];
}
#endif
#endif
