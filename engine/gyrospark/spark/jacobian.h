/* SPARK methods: the dense Jacobian of T1. */
#ifndef GS_SPARK_JACOBIAN_H
#define GS_SPARK_JACOBIAN_H

#include "gyrospark/spark/residual.h"

#include "gyrospark/spark/rates_by_state.h"

/*
 * J <- dr/dx at the stage values of the last residual. K_l = d(G_l^T Lambda_l)/dQ~_l enters through
 * dP_i/dk_j = B_ij = -dt^2 sum_l a~_il a-_lj K_l:
 *   d(k_i row)/dk_j = delta - dt a_ij H_pq - H_pp B_ij,   d/dk^_j = -dt a^_ij H_pp,
 *   d(k^_i row)/dk_j = dt a_ij H_qq + H_qp B_ij,          d/dk^_j = delta + dt a^_ij H_qp,
 * and d/dLambda_l is H_pp and H_qp times -dt a~_il G_l^T in place of B_ij.
 */
static void jacobian(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real J[U*U])
{
    (void)q, (void)p, (void)x;
    for (int e = 0; e < U*U; ++e)
        J[e] = 0;
#if GS_CONSTRAINED
    for (int l = 0; l <= P; ++l)
        constraint_jacobian(AT(&w->constants, w->t + w->node_time[l]), w->Q_tilde[l], w->G[l]);
    for (int l = 0; l < P; ++l)
        constraint_curvature(AT(&w->constants,
            w->t + w->node_time[l]), w->Q_tilde[l], x + LAMBDA + l*M, w->K[l]);
#endif
    for (int i = 0; i < S; ++i) {
        real H_qq[N][N], H_qp[N][N], H_pq[N][N], H_pp[N][N];
        const real t = w->t + dt*tableau.c[i];
        rates_by_state(AT(&w->constants,
            t), w->stage_q[i], w->stage_p[i], &t, H_qq, H_qp, H_pq, H_pp);
        for (int j = 0; j < S; ++j) {
#if GS_EXACT_ENERGY
            const real a_ij = dt*stage_entry(w, i, j), a_hat = a_ij;
#else
            const real a_ij = dt*tableau.A[i][j], a_hat = dt*tableau.A_hat[i][j];
#endif
#if GS_CONSTRAINED
            real B[N][N];
            for (int a = 0; a < N; ++a)
                for (int b = 0; b < N; ++b) {
                    real sum = 0;
                    for (int l = 0; l < P; ++l)
#if GS_EXACT_ENERGY
                        sum += force_entry(w, i, l)*node_entry(w, l, j)*w->K[l][a][b];
#else
                        sum += tableau.A_tilde[i][l]*tableau.A_bar[l][j]*w->K[l][a][b];
#endif
                    B[a][b] = -dt*dt*sum;
                }
#endif
            for (int a = 0; a < N; ++a) {
                real *upper = J + (i*N + a)*U, *lower = J + (K_HAT + i*N + a)*U;
                for (int b = 0; b < N; ++b) {
                    const real one = i == j && a == b ? 1 : 0;
                    real by_k = a_ij*H_pq[a][b], by_k_lower = a_ij*H_qq[a][b];
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
                    real by_p = 0, by_p_lower = 0;
                    for (int e = 0; e < N; ++e) {
                        by_p += H_pp[a][e]*w->G[l][mu][e];
                        by_p_lower += H_qp[a][e]*w->G[l][mu][e];
                    }
#if GS_EXACT_ENERGY
                    const real a_tilde = dt*force_entry(w, i, l);
#else
                    const real a_tilde = dt*tableau.A_tilde[i][l];
#endif
                    J[(i*N + a)*U + column] = a_tilde*by_p;
                    J[(K_HAT + i*N + a)*U + column] = -a_tilde*by_p_lower;
                }
#endif
    }
#if GS_CONSTRAINED
    for (int l = 1; l <= P; ++l)
        for (int mu = 0; mu < M; ++mu) {
            real *row = J + (LAMBDA + (l - 1)*M + mu)*U;
            for (int j = 0; j < S; ++j)
                for (int b = 0; b < N; ++b)
#if GS_EXACT_ENERGY
                    row[j*N + b] = dt*node_entry(w, l, j)*w->G[l][mu][b];
#else
                    row[j*N + b] = dt*tableau.A_bar[l][j]*w->G[l][mu][b];
#endif
        }
#endif
#if GS_VELOCITY_CONSTRAINTS
    add_velocity_constraints(w, dt, q, p, x, J);
#endif
}

#endif
