/*
 * Implicit midpoint (IMS) and energy-momentum (EMS) schemes: the linearised equations of a step and
 * their transpose, on numbers or lanes. x = (dq, dp, lambda), q1 = q + dq, p1 = p + dp; at fixed x
 * the start moves the mean values.
 */
#include "gyrospark/derivatives/solution.h"

#if !GS_DERIVATIVES_IN_LANES
/*
 * dx and dz1 <- the derivatives of the unknowns and of (q1, p1) along dz: rows q, p, constants, t0,
 * h. multipliers, if not NULL, are those of lambda.
 */
static int TYPED(step_tangent)(TYPED(linearisation_t) *l, const NUMBER dz[Z], NUMBER dx[U],
    NUMBER dz1[2*N], NUMBER *multipliers)
{
    const NUMBER zero = TYPED(broadcast)(0), squared = l->h*l->h;
    NUMBER dc[E], velocity[N], force[N];
    for (int a = 0; a < N; ++a)
        velocity[a] = force[a] = zero;
    TYPED(set_time_direction)(dz, TYPED(broadcast)((real)0.5), dc);
    TYPED(mean_times)(l, dz, dz + N, dc, force, velocity);
    for (int a = 0; a < N; ++a) { /* r = dq/h - D_p, dp/h + D_q */
        dx[a] = velocity[a] + l->x[a]/squared*dz[DH];
        dx[DP + a] = l->x[DP + a]/squared*dz[DH] - force[a];
    }
#if GS_CONSTRAINED
    NUMBER dg[M];
    for (int m = 0; m < M; ++m)
        dg[m] = zero;
    TYPED(set_time_direction)(dz, TYPED(broadcast)(1), dc);
    TYPED(constraint_times)(l, P, dz, dc, dg);
    for (int m = 0; m < M; ++m)
        dx[LAMBDA + m] = -dg[m];
#endif
    const int status = TYPED(solve_step)(l, 0, dx);
    if (status != OK)
        return status;
    for (int a = 0; a < 2*N; ++a)
        dz1[a] = dz[a] + dx[a];
    for (int e = 2*N; e < U && multipliers != NULL; ++e)
        multipliers[e - 2*N] = dx[e];
    return OK;
}
#endif

/*
 * The cotangent w of (q1, p1) = (q, p) + (dq, dp) is one of the unknowns and of the start; that of
 * lambda, multipliers, if not NULL, is one of the unknowns.
 */
static void TYPED(adjoint_of_end)(TYPED(linearisation_t) *l, const NUMBER w[2*N],
    const NUMBER *multipliers, NUMBER x[U], NUMBER force[P][N], NUMBER z[Z])
{
    const NUMBER zero = TYPED(broadcast)(0);
    (void)l, (void)force;
    for (int e = 0; e < Z; ++e)
        z[e] = e < 2*N ? w[e] : zero;
    for (int e = 0; e < U; ++e)
        x[e] = e < 2*N ? w[e] : multipliers == NULL ? zero : multipliers[e - 2*N];
}

/* The transposed derivative of the residual at fixed unknowns, of x <- J^-T x, added to z. */
static void TYPED(adjoint_of_stages)(TYPED(linearisation_t) *l, const NUMBER x[U],
    NUMBER force[P][N], NUMBER z[Z])
{
    const NUMBER zero = TYPED(broadcast)(0), squared = l->h*l->h;
    NUMBER by_c[E], force_bar[N];
    (void)force;
    for (int e = 0; e < E; ++e)
        by_c[e] = zero;
    for (int a = 0; a < N; ++a) {
        force_bar[a] = -x[DP + a];
        z[DH] += (l->x[a]*x[a] + l->x[DP + a]*x[DP + a])/squared;
    }
    TYPED(mean_transposed)(l, force_bar, x, z, z + N, by_c);
    TYPED(add_time_cotangent)(by_c, TYPED(broadcast)((real)0.5), z);
#if GS_CONSTRAINED
    NUMBER g_bar[M];
    for (int m = 0; m < M; ++m)
        g_bar[m] = -x[LAMBDA + m];
    for (int e = 0; e < E; ++e)
        by_c[e] = zero;
    TYPED(constraint_transposed)(l, P, g_bar, z, by_c);
#if TIMES > 1
    by_c[E - 1] = zero; /* g at the end of the step depends on one time only */
#endif
    TYPED(add_time_cotangent)(by_c, TYPED(broadcast)(1), z);
#endif
}

/* z <- the cotangent of (q, p, constants, t0, h) of those of (q1, p1), w, and of multipliers. */
static inline int TYPED(step_adjoint)(TYPED(linearisation_t) *l, const NUMBER w[2*N],
    const NUMBER *multipliers, NUMBER z[Z])
{
    NUMBER x[U], force[P][N];
    TYPED(adjoint_of_end)(l, w, multipliers, x, force, z);
    const int status = TYPED(solve_step)(l, 1, x);
    if (status == OK)
        TYPED(adjoint_of_stages)(l, x, force, z);
    return status;
}
