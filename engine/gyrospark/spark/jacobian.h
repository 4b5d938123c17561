/* SPARK methods: the dense Jacobian of T1. */
#ifndef GS_SPARK_JACOBIAN_H
#define GS_SPARK_JACOBIAN_H

#include "gyrospark/spark/residual.h"

#include "gyrospark/spark/rates_by_state.h"

/* J <- dr/dx at the stage values of the last residual. */
static void jacobian(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real J[U*U])
{
#if GS_EXACT_ENERGY
    const real *theta = w->theta;
#else
    const real *theta = NULL;
#endif
    (void)q, (void)p, (void)x;
    for (int e = 0; e < U*U; ++e)
        J[e] = 0;
#if GS_CONSTRAINED
    for (int l = 0; l <= P; ++l)
        constraint_jacobian(AT(&w->constants, w->t + w->node_time[l]), w->Q_tilde[l], w->G[l]);
    for (int l = 0; l < P; ++l)
        constraint_curvature(AT(&w->constants,
            w->t + w->node_time[l]), w->Q_tilde[l], x + LAMBDA + l*M, w->K[l]);
    fill_node_rows(theta, dt, w->G, J);
#endif
    for (int i = 0; i < S; ++i) {
        real H_qq[N][N], H_qp[N][N], H_pq[N][N], H_pp[N][N];
        const real t = w->t + dt*tableau.c[i];
        rates_by_state(AT(&w->constants,
            t), w->stage_q[i], w->stage_p[i], &t, H_qq, H_qp, H_pq, H_pp);
        fill_stage_rows(theta, dt, i, H_qq, H_qp, H_pq, H_pp, IF_CONSTRAINED(w->G, w->K,) J);
    }
#if GS_VELOCITY_CONSTRAINTS
    add_velocity_constraints(w, dt, q, p, x, J);
#endif
}

#endif
