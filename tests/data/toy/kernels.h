/* The kernels of the toy on NUMBER, with names TYPED(f): included for numbers and for lanes. */

#define ZERO ((NUMBER){ 0 })

#if GS_TIME_DEPENDENT
static inline const TYPED(constants) *TYPED(at_time)(TYPED(constants) *c, NUMBER t)
{
    c->_t = t;
    c->_dt = ZERO;
    return c;
}

static inline const TYPED(constants) *TYPED(between)(TYPED(constants) *c, NUMBER t, NUMBER step)
{
    c->_t = t + step/2;
    c->_dt = step;
    return c;
}

static inline NUMBER TYPED(stiffness)(const TYPED(constants) *c)
{
    return c->k + c->drive*c->_t;
}
#else
static inline NUMBER TYPED(stiffness)(const TYPED(constants) *c)
{
    return c->k;
}
#endif

static inline NUMBER TYPED(potential)(const TYPED(constants) *c, const NUMBER *q)
{
    NUMBER sum = -(c->u*q[0]);
    for (int a = 0; a < N; ++a)
        sum += TYPED(stiffness)(c)*q[a]*q[a]/2;
    return sum;
}

/* ---------------------------------------------------------------------------- constraints */

#if GS_CONSTRAINED
static inline void TYPED(constraint)(const TYPED(constants) *c, const NUMBER *q, NUMBER *g)
{
    (void)c;
    g[0] = ZERO - 1;
    for (int a = 0; a < N; ++a)
        g[0] += squares[a]*q[a]*q[a];
    if (M > 1)
        g[M - 1] = q[0] - q[N - 1];
}

static inline void TYPED(constraint_increment)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *d, NUMBER *dg)
{
    (void)c;
    dg[0] = ZERO;
    for (int a = 0; a < N; ++a)
        dg[0] += squares[a]*d[a]*(2*q[a] + d[a]);
    if (M > 1)
        dg[M - 1] = d[0] - d[N - 1];
}

static inline void TYPED(constraint_jacobian)(const TYPED(constants) *c, const NUMBER *q,
    NUMBER G[M][N])
{
    (void)c;
    for (int a = 0; a < N; ++a)
        G[0][a] = 2*squares[a]*q[a];
    for (int a = 0; a < N && M > 1; ++a)
        G[M - 1][a] = ZERO + (a == 0 ? 1 : a == N - 1 ? -1 : 0);
}

static inline void TYPED(constraint_rate)(const TYPED(constants) *c, const NUMBER *q, NUMBER *rate)
{
    (void)c, (void)q;
    for (int mu = 0; mu < M; ++mu)
        rate[mu] = ZERO;
}

/* G between q_mean - dq/2 and q_mean + dq/2: exact, for g is quadratic. */
static inline void TYPED(mean_constraint)(const TYPED(constants) *c, const NUMBER *q_mean,
    const NUMBER *dq, NUMBER G[M][N])
{
    (void)dq;
    TYPED(constraint_jacobian)(c, q_mean, G);
}

static inline void TYPED(mean_constraint_rate)(const TYPED(constants) *c, const NUMBER *q_mean,
    const NUMBER *dq, NUMBER *rate)
{
    (void)dq;
    TYPED(constraint_rate)(c, q_mean, rate);
}
#endif

#if GS_ELEMENTS && GS_CONSTRAINED
/* G^T lambda, by element templates */
static inline void TYPED(constraint_force)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *lambda, NUMBER *sum)
{
    NUMBER G[M][N];
    TYPED(constraint_jacobian)(c, q, G);
    for (int a = 0; a < N; ++a) {
        sum[a] = ZERO;
        for (int mu = 0; mu < M; ++mu)
            sum[a] += G[mu][a]*lambda[mu];
    }
}

static inline void TYPED(mean_pull)(const TYPED(constants) *c, const NUMBER *q_mean,
    const NUMBER *dq, const NUMBER *lambda, NUMBER *sum)
{
    (void)dq;
    TYPED(constraint_force)(c, q_mean, lambda, sum);
}
#endif

#if GS_LAGRANGIAN
/* ---------------------------------------------------- L = v^T m v/2 + b.v - V(q), m constant */

#ifndef MASS_ENTRIES
#define MASS_ENTRIES 5
enum { MASS = MASS_ENTRIES + (GS_INDEFINITE_MASS ? 2*N*N : 0) };
/* m couples 0 to 1 and 1 to 2: entries m00, m11, m22, m10, m21. */
static const int mass_order[N] = { 0, 1, 2 }, mass_rows[N] = { 1, 1, 0 };
static const int mass_row[2] = { 1, 2 }, mass_slot[2] = { 3, 4 }, mass_target[1] = { 0 };
static const real mass_entry[5] = { 2, GS_INDEFINITE_MASS ? -3 : 3, 4, 1, -1 };
#endif

static inline void TYPED(mass_matrix)(const TYPED(constants) *c, const NUMBER *q, NUMBER *A)
{
    (void)c, (void)q;
    for (int e = 0; e < MASS_ENTRIES; ++e)
        A[e] = ZERO + mass_entry[e];
}

/* b, the momentum at rest */
static inline void TYPED(rest_momentum)(const TYPED(constants) *c, const NUMBER *q, NUMBER *b)
{
    for (int a = 0; a < N; ++a)
        b[a] = c->omega*q[a];
}

static inline void TYPED(force_of_velocity)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *v, const NUMBER *t, NUMBER *F)
{
    (void)q, (void)t;
    for (int a = 0; a < N; ++a)
        F[a] = -(c->damping*v[a]);
}

/* dL/dq + F */
static inline void TYPED(generalised_force)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *v, const NUMBER *t, NUMBER *R)
{
    NUMBER F[N];
    TYPED(force_of_velocity)(c, q, v, t, F);
    for (int a = 0; a < N; ++a)
        R[a] = c->omega*v[a] - TYPED(stiffness)(c)*q[a] + (GS_FORCES ? F[a] : ZERO);
    R[0] += c->u;
}

/* The change of dL/dq along (dq, dv). */
static inline void TYPED(force_derivative)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *v, const NUMBER *dq, const NUMBER *dv, NUMBER *change)
{
    (void)q, (void)v;
    for (int a = 0; a < N; ++a)
        change[a] = c->omega*dv[a] - TYPED(stiffness)(c)*dq[a];
}

static inline void TYPED(applied_force_derivative)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *v, const NUMBER *t, const NUMBER *dq, const NUMBER *dv, NUMBER *dF)
{
    (void)dq, (void)v;
    TYPED(force_of_velocity)(c, q, dv, t, dF);
}

/* dL/dq + F between two ends with the velocities v0 and v1. */
static inline void TYPED(mean_generalised_force)(const TYPED(constants) *c, const NUMBER *q_mean,
    const NUMBER *dq, const NUMBER *v0, const NUMBER *v1, const NUMBER *t, NUMBER *R)
{
    NUMBER v[N];
    (void)dq;
    for (int a = 0; a < N; ++a)
        v[a] = (v0[a] + v1[a])/2;
    TYPED(generalised_force)(c, q_mean, v, t, R);
}

/* Its change along (dq, dv) of the later end. */
static inline void TYPED(mean_generalised_force_derivative)(const TYPED(constants) *c,
    const NUMBER *q_mean, const NUMBER *d, const NUMBER *v0, const NUMBER *v1, const NUMBER *t,
    const NUMBER *dq, const NUMBER *dv, NUMBER *change)
{
    NUMBER dF[N];
    (void)d, (void)v1;
    TYPED(force_derivative)(c, q_mean, v0, dq, dv, change);
    TYPED(force_of_velocity)(c, q_mean, dv, t, dF);
    for (int a = 0; a < N; ++a)
        change[a] = (change[a] + (GS_FORCES ? dF[a] : ZERO))/2;
}

/* H_t */
static inline NUMBER TYPED(energy_rate_of_velocity)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *v)
{
    NUMBER sum = ZERO;
    (void)v;
    for (int a = 0; a < N; ++a)
        sum += c->drive*q[a]*q[a]/2;
    return sum;
}

static inline NUMBER TYPED(mean_energy_rate_of_velocities)(const TYPED(constants) *c,
    const NUMBER *q_mean, const NUMBER *dq, const NUMBER *v0, const NUMBER *v1)
{
    (void)v1;
    return TYPED(energy_rate_of_velocity)(c, q_mean, v0)
        + TYPED(energy_rate_of_velocity)(c, dq, v0)/4;
}

#if TOY_LEGENDRE
#include "gyrospark/lagrangian/legendre.h"
#endif
#else
/* ---------------------------------------------------- H = p.p/2 + V(q), less omega J in H_q, H_p */

static inline NUMBER TYPED(hamiltonian)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *p)
{
    NUMBER sum = TYPED(potential)(c, q);
    for (int a = 0; a < N; ++a)
        sum += p[a]*p[a]/2;
    return sum;
}

static inline void TYPED(frame_velocity)(const TYPED(constants) *c, const NUMBER *q, NUMBER *v)
{
    v[0] = -(c->omega*q[1]);
    v[1] = c->omega*q[0];
    v[2] = ZERO;
}

/* H_p */
static inline void TYPED(velocity)(const TYPED(constants) *c, const NUMBER *q, const NUMBER *p,
    NUMBER *H_p)
{
    NUMBER v[N];
    TYPED(frame_velocity)(c, q, v);
    for (int a = 0; a < N; ++a)
        H_p[a] = p[a] - v[a];
}

static inline void TYPED(applied_force)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *p, const NUMBER *t, NUMBER *F)
{
    (void)q, (void)t;
    for (int a = 0; a < N; ++a)
        F[a] = -(c->damping*p[a]);
}

/* H_q - F */
static inline void TYPED(force)(const TYPED(constants) *c, const NUMBER *q, const NUMBER *p,
    NUMBER *H_q)
{
    NUMBER v[N], F[N];
    TYPED(frame_velocity)(c, p, v);
    TYPED(applied_force)(c, q, p, NULL, F);
    for (int a = 0; a < N; ++a)
        H_q[a] = TYPED(stiffness)(c)*q[a] + v[a] - (GS_FORCES ? F[a] : ZERO);
    H_q[0] -= c->u;
}

static inline NUMBER TYPED(energy_rate)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *p)
{
    NUMBER sum = ZERO;
    (void)p;
    for (int a = 0; a < N; ++a)
        sum += c->drive*q[a]*q[a]/2;
    return sum;
}

static inline NUMBER TYPED(mean_energy_rate)(const TYPED(constants) *c, const NUMBER *q_mean,
    const NUMBER *p_mean, const NUMBER *dq, const NUMBER *dp)
{
    (void)dp;
    return TYPED(energy_rate)(c, q_mean, p_mean) + TYPED(energy_rate)(c, dq, p_mean)/4;
}

static inline void TYPED(mean_velocity)(const TYPED(constants) *c, const NUMBER *q_mean,
    const NUMBER *p_mean, const NUMBER *dq, const NUMBER *dp, NUMBER *D_p)
{
    (void)dq, (void)dp;
    TYPED(velocity)(c, q_mean, p_mean, D_p);
}

static inline void TYPED(mean_force)(const TYPED(constants) *c, const NUMBER *q_mean,
    const NUMBER *p_mean, const NUMBER *dq, const NUMBER *dp, const NUMBER *t, NUMBER *D_q)
{
    (void)dq, (void)dp, (void)t;
    TYPED(force)(c, q_mean, p_mean, D_q);
}

static inline void TYPED(gradient)(const TYPED(constants) *c, const NUMBER *q, const NUMBER *p,
    const NUMBER *t, NUMBER *H_q, NUMBER *H_p)
{
    (void)t;
    TYPED(force)(c, q, p, H_q);
    TYPED(velocity)(c, q, p, H_p);
}

static inline void TYPED(mean_gradient)(const TYPED(constants) *c, const NUMBER *q_mean,
    const NUMBER *p_mean, const NUMBER *dq, const NUMBER *dp, const NUMBER *t, NUMBER *D_q,
    NUMBER *D_p)
{
    (void)dq, (void)dp;
    TYPED(gradient)(c, q_mean, p_mean, t, D_q, D_p);
}

/* H_qq, d(H_q - F)/dp, H_pq and H_pp */
static inline void TYPED(second_derivatives)(const TYPED(constants) *c, NUMBER H_qq[N][N],
    NUMBER H_qp[N][N], NUMBER H_pq[N][N], NUMBER H_pp[N][N])
{
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b) {
            const NUMBER turn = a == 0 && b == 1 ? c->omega : a == 1 && b == 0 ? -c->omega : ZERO;
            const NUMBER one = ZERO + (a == b);
            H_qq[a][b] = one*TYPED(stiffness)(c);
            H_pp[a][b] = one;
            H_pq[a][b] = turn;
            H_qp[a][b] = (GS_FORCES ? one*c->damping : ZERO) - turn;
        }
}

#if GS_FORCES
static inline void TYPED(hessian)(const TYPED(constants) *c, const NUMBER *q, const NUMBER *p,
    const NUMBER *t, NUMBER H_qq[N][N], NUMBER H_qp[N][N], NUMBER H_pq[N][N], NUMBER H_pp[N][N])
{
    (void)q, (void)p, (void)t;
    TYPED(second_derivatives)(c, H_qq, H_qp, H_pq, H_pp);
}
#else
static inline void TYPED(hessian)(const TYPED(constants) *c, const NUMBER *q, const NUMBER *p,
    const NUMBER *t, NUMBER H_qq[N][N], NUMBER H_pq[N][N], NUMBER H_pp[N][N])
{
    NUMBER H_qp[N][N];
    (void)q, (void)p, (void)t;
    TYPED(second_derivatives)(c, H_qq, H_qp, H_pq, H_pp);
}
#endif

/* Derivatives of the mean gradient by the increments dq and dp: half of those by the means. */
static inline void TYPED(mean_jacobian)(const TYPED(constants) *c, const NUMBER *q_mean,
    const NUMBER *p_mean, const NUMBER *dq, const NUMBER *dp, const NUMBER *t,
    NUMBER D_qq[N][N], NUMBER D_qp[N][N], NUMBER D_pq[N][N], NUMBER D_pp[N][N])
{
    (void)q_mean, (void)p_mean, (void)dq, (void)dp, (void)t;
    TYPED(second_derivatives)(c, D_qq, D_qp, D_pq, D_pp);
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b) {
            D_qq[a][b] /= 2;
            D_qp[a][b] /= 2;
            D_pq[a][b] /= 2;
            D_pp[a][b] /= 2;
        }
}

#if GS_CONSTRAINED
static inline void TYPED(hidden_constraint)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *p, NUMBER *f)
{
    NUMBER G[M][N], H_p[N];
    TYPED(constraint_jacobian)(c, q, G);
    TYPED(velocity)(c, q, p, H_p);
    for (int mu = 0; mu < M; ++mu) {
        f[mu] = ZERO;
        for (int a = 0; a < N; ++a)
            f[mu] += G[mu][a]*H_p[a];
    }
}

/* (df/dp) G^T = G G^T */
static inline void TYPED(hidden_matrix)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *p, NUMBER W[M][M])
{
    NUMBER G[M][N];
    (void)p;
    TYPED(constraint_jacobian)(c, q, G);
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu) {
            W[mu][nu] = ZERO;
            for (int a = 0; a < N; ++a)
                W[mu][nu] += G[mu][a]*G[nu][a];
        }
}
#endif
#endif

#if GS_CONSTRAINED
static inline void TYPED(constraint_curvature)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *lambda, NUMBER K[N][N])
{
    (void)c, (void)q;
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b)
            K[a][b] = a == b ? 2*squares[a]*lambda[0] : ZERO;
}

static inline void TYPED(mean_curvature)(const TYPED(constants) *c, const NUMBER *q_mean,
    const NUMBER *dq, const NUMBER *lambda, NUMBER K[N][N])
{
    (void)dq;
    TYPED(constraint_curvature)(c, q_mean, lambda, K);
    for (int a = 0; a < N; ++a)
        K[a][a] /= 2;
}

#if !GS_ELEMENTS && !(GS_LAGRANGIAN && TOY_LEGENDRE)
/* W = G H_pp G^T */
static inline void TYPED(schur)(const TYPED(constants) *c, const NUMBER *q, const NUMBER *p,
    NUMBER W[M][M])
{
#if !GS_LAGRANGIAN
    TYPED(hidden_matrix)(c, q, p, W);
#else
    (void)c, (void)q, (void)p, (void)W;
#endif
}
#endif

/* W^-1 on the unit sphere, where |G|^2 = 4; and c with H_pp G^T = c G^T */
static inline void TYPED(schur_inverse)(const TYPED(constants) *c, NUMBER W_inverse[M][M])
{
    (void)c;
    W_inverse[0][0] = ZERO + (real)0.25;
}

static inline NUMBER TYPED(correction)(const TYPED(constants) *c)
{
    (void)c;
    return ZERO + 1;
}
#endif

#undef ZERO
