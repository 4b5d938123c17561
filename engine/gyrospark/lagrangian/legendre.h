/* Legendre transform: H, its derivatives and the hidden constraints from a Lagrangian. */

#include "gyrospark/linear_algebra/mass_matrix.h"

/* H = (p - b)^T M^-1 (p - b)/2 + V */
static NUMBER TYPED(hamiltonian)(const TYPED(constants) *c, const NUMBER q[N], const NUMBER p[N])
{
    NUMBER A[MASS], b[N], v[N];
    TYPED(factor_mass)(c, q, A);
    TYPED(velocities)(c, q, p, A, v);
    TYPED(rest_momentum)(c, q, b);
    NUMBER sum = (p[0] - b[0])*v[0];
    for (int a = 1; a < N; ++a)
        sum += (p[a] - b[a])*v[a];
    return (real)0.5*sum + TYPED(potential)(c, q);
}

#if GS_CONSTRAINED
/* f = G v + g_t; g_t = 0 unless L or g is rheonomic */
static inline void TYPED(hidden_constraint)(const TYPED(constants) *c, const NUMBER q[N],
    const NUMBER p[N], NUMBER f[M])
{
    NUMBER A[MASS], v[N], G[M][N];
    IF_TIME(NUMBER rate[M];)
    TYPED(factor_mass)(c, q, A);
    TYPED(velocities)(c, q, p, A, v);
    TYPED(constraint_jacobian)(c, q, G);
    IF_TIME(TYPED(constraint_rate)(c, q, rate);)
    for (int mu = 0; mu < M; ++mu) {
        f[mu] = G[mu][0]*v[0];
        for (int a = 1; a < N; ++a)
            f[mu] += G[mu][a]*v[a];
        IF_TIME(f[mu] += rate[mu];)
    }
}

/* W = G M^-1 G^T */
static inline void TYPED(hidden_matrix)(const TYPED(constants) *c, const NUMBER q[N],
    const NUMBER p[N], NUMBER W[M][M])
{
    NUMBER A[MASS], G[M][N];
    (void)p;
    TYPED(factor_mass)(c, q, A);
    TYPED(constraint_jacobian)(c, q, G);
    for (int mu = 0; mu < M; ++mu) {
        NUMBER v[N];
        for (int a = 0; a < N; ++a)
            v[a] = G[mu][a];
        TYPED(solve_mass)(A, v);
        for (int nu = 0; nu <= mu; ++nu) {
            NUMBER sum = G[nu][0]*v[0];
            for (int a = 1; a < N; ++a)
                sum += G[nu][a]*v[a];
            W[mu][nu] = W[nu][mu] = sum;
        }
    }
}
#endif

#if GS_ENERGY_MOMENTUM
/*
 * Velocities v0 and v1 at both ends of a step with mean values qm, pm and increments dq, dp. The
 * constants hold the mean time. Also returns q1 and the factors A of M(q1).
 */
static void TYPED(end_velocities)(const TYPED(constants) *c, const NUMBER qm[N],
    const NUMBER pm[N], const NUMBER dq[N], const NUMBER dp[N], NUMBER q1[N], NUMBER A[MASS],
    NUMBER v0[N], NUMBER v1[N])
{
    NUMBER q0[N], p0[N], p1[N];
    IF_TIME(TYPED(constants) end = *c;)
    IF_TIME(const NUMBER middle = c->_t, half = (real)0.5*c->_dt;)
    IF_TIME(c = TYPED(at_time)(&end, middle - half);)
    for (int a = 0; a < N; ++a) {
        q0[a] = qm[a] - (real)0.5*dq[a];
        p0[a] = pm[a] - (real)0.5*dp[a];
        q1[a] = qm[a] + (real)0.5*dq[a];
        p1[a] = pm[a] + (real)0.5*dp[a];
    }
    TYPED(factor_mass)(c, q0, A);
    TYPED(velocities)(c, q0, p0, A, v0);
    IF_TIME(c = TYPED(at_time)(&end, middle + half);)
    TYPED(factor_mass)(c, q1, A);
    TYPED(velocities)(c, q1, p1, A, v1);
}

#if GS_TIME_DEPENDENT
/* D_t, the discrete time derivative of H between both ends */
static inline NUMBER TYPED(mean_energy_rate)(const TYPED(constants) *c, const NUMBER qm[N],
    const NUMBER pm[N], const NUMBER dq[N], const NUMBER dp[N])
{
    NUMBER q1[N], A[MASS], v0[N], v1[N];
    TYPED(end_velocities)(c, qm, pm, dq, dp, q1, A, v0, v1);
    return TYPED(mean_energy_rate_of_velocities)(c, qm, dq, v0, v1);
}
#endif
#else
#if GS_FORCES
/* F(q, v, t) at the velocity v = M^-1 (p - b) */
static inline void TYPED(applied_force)(const TYPED(constants) *c, const NUMBER q[N],
    const NUMBER p[N], const NUMBER t[1], NUMBER F[N])
{
    NUMBER A[MASS], v[N];
    TYPED(factor_mass)(c, q, A);
    TYPED(velocities)(c, q, p, A, v);
    TYPED(force_of_velocity)(c, q, v, t, F);
}
#endif

#if GS_TIME_DEPENDENT
/* H_t = -L_t at the velocity v = M^-1 (p - b) */
static inline NUMBER TYPED(energy_rate)(const TYPED(constants) *c, const NUMBER q[N],
    const NUMBER p[N])
{
    NUMBER A[MASS], v[N];
    TYPED(factor_mass)(c, q, A);
    TYPED(velocities)(c, q, p, A, v);
    return TYPED(energy_rate_of_velocity)(c, q, v);
}

#if !GS_SPARK
/* D_t: H_t at the midpoint */
static inline NUMBER TYPED(mean_energy_rate)(const TYPED(constants) *c, const NUMBER qm[N],
    const NUMBER pm[N], const NUMBER dq[N], const NUMBER dp[N])
{
    (void)dq, (void)dp;
    return TYPED(energy_rate)(c, qm, pm);
}
#endif
#endif
#endif
