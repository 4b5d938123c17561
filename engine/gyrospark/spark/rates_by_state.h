/* SPARK methods: derivatives of H_q - F and H_p by q and p, of a Hamiltonian. */
#ifndef GS_SPARK_RATES_BY_STATE_H
#define GS_SPARK_RATES_BY_STATE_H

#include "gyrospark/engine.h"

#if !GS_LAGRANGIAN
/* Derivatives of H_q - F and H_p. H_qp is the transpose of H_pq but for forces. */
static inline void rates_by_state(const constants *c, const real q[N], const real p[N],
    const real t[1], real H_qq[N][N], real H_qp[N][N], real H_pq[N][N], real H_pp[N][N])
{
#if GS_FORCES
    hessian(c, q, p, t, H_qq, H_qp, H_pq, H_pp);
#else
    hessian(c, q, p, t, H_qq, H_pq, H_pp);
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b)
            H_qp[a][b] = H_pq[b][a];
#endif
}
#else
#include "gyrospark/lagrangian/derivatives.h"
#endif

#endif
