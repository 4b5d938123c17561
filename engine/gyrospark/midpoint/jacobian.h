/* Implicit midpoint (IMS) and energy-momentum (EMS) schemes: the Jacobian of the residual. */
#ifndef GS_MIDPOINT_JACOBIAN_H
#define GS_MIDPOINT_JACOBIAN_H

#include "gyrospark/midpoint/residual.h"

#if GS_CONSTRAINED
/* Adds the constraint blocks to the Jacobian: d(G^T lambda)/d(dq), the mean G^T, and G(q1). */
static void constraint_columns(work_t *w, const real q[N], const real x[U], real J[U*U])
{
    real K[N][N], q1[N], G[M][N], G1[M][N];
    mean_curvature(&w->constants, w->q_mean, x, x + LAMBDA, K);
    mean_constraint(&w->constants, w->q_mean, x, G);
    for (int a = 0; a < N; ++a)
        q1[a] = q[a] + x[a];
    constraint_jacobian(AT(&w->constants, w->t + w->step), q1, G1);
    for (int a = 0; a < N; ++a) {
        for (int b = 0; b < N; ++b)
            J[(DP + a)*U + b] += K[a][b];
        for (int mu = 0; mu < M; ++mu) {
            J[(DP + a)*U + LAMBDA + mu] = G[mu][a];
            J[(LAMBDA + mu)*U + a] = G1[mu][a];
        }
    }
}
#endif

/* J <- dr/dx at the mean values of the last residual. */
static void jacobian(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real J[U*U])
{
    real D_qq[N][N], D_qp[N][N], D_pq[N][N], D_pp[N][N];
    const real t = w->t + dt/2;
    (void)q, (void)p;
    mean_jacobian(BETWEEN(&w->constants,
        w->t, w->step), w->q_mean, w->p_mean, x, x + DP, &t, D_qq, D_qp, D_pq, D_pp);
    for (int e = 0; e < U*U; ++e)
        J[e] = 0;
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b) {
            const real rate = a == b ? 1/dt : 0;
            J[a*U + b] = rate - D_pq[a][b];
            J[a*U + DP + b] = -D_pp[a][b];
            J[(DP + a)*U + b] = D_qq[a][b];
            J[(DP + a)*U + DP + b] = rate + D_qp[a][b];
        }
    IF_CONSTRAINED(constraint_columns(w, q, x, J);)
}

#endif
