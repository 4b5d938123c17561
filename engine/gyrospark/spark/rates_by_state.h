/* SPARK methods: derivatives of H_q - F and H_p by q and p, of a Hamiltonian. */
#ifndef GS_SPARK_RATES_BY_STATE_H
#define GS_SPARK_RATES_BY_STATE_H

#include "gyrospark/engine.h"

#if !GS_LAGRANGIAN
#if GS_FORCES
/*
 * H_qq and H_qp <- the derivatives of H_q - F by q and p. Forces destroy the symmetry: H_qp is not
 * the transpose of H_pq.
 */
static inline void rates_by_state(const constants *c, const real q[N], const real p[N],
    const real t[1], real H_qq[N][N], real H_qp[N][N], real H_pq[N][N], real H_pp[N][N])
{
    hessian(c, q, p, t, H_qq, H_qp, H_pq, H_pp);
}
#else
/* The Hessian of H; without forces H_qp is the transpose of H_pq. */
static inline void rates_by_state(const constants *c, const real q[N], const real p[N],
    const real t[1], real H_qq[N][N], real H_qp[N][N], real H_pq[N][N], real H_pp[N][N])
{
    hessian(c, q, p, t, H_qq, H_pq, H_pp);
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b)
            H_qp[a][b] = H_pq[b][a];
}
#endif
#else
#include "gyrospark/lagrangian/derivatives.h"
#endif

#endif
