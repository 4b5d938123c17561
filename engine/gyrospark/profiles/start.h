/* Profile control: a start from velocities, and velocities of a state. */
#ifndef GS_PROFILES_START_H
#define GS_PROFILES_START_H

#include "gyrospark/profiles/arguments.h"

/* Scales quaternions to |q| = 1; one that is there up to round-off keeps its bits. */
static void normalise_quaternions(real q[N])
{
    for (int b = 0; b < QUATERNIONS; ++b) {
        real square = (real)0;
        for (int e = 0; e < 4; ++e) {
            const real x = q[quaternion[b][e]];
            square += x*x;
        }
        if (MATH(fabs)(square - (real)1) > ((real)4*epsilon)) {
            for (int e = 0; e < 4; ++e) {
                q[quaternion[b][e]] /= MATH(sqrt)(square);
            }
        }
    }
}

#if GS_HELD
/*
 * Whether q is on g = 0 and q' = B(q) v on g_q q' = 0, to half of the digits: |g| and |g_q q'| are
 * small beside |g_q| |q| and |g_q| |q'|.
 */
static bool is_consistent(const parameters_t *parameters, const real q[N], const real v[V])
{
    const real allowed = (real)16*epsilon;
    real g[HELD];
    real f[HELD];
    real square[HELD];
    real rate[N];
    real q_square = (real)0;
    real rate_square = (real)0;
    bool consistent = true;
    start_defects(parameters, q, v, rate, g, f, square);
    for (int a = 0; a < N; ++a) {
        q_square += q[a]*q[a];
        rate_square += rate[a]*rate[a];
    }
    for (int mu = 0; mu < HELD; ++mu) {
        consistent = consistent && ((g[mu]*g[mu]) <= (allowed*square[mu]*q_square))
            && ((f[mu]*f[mu]) <= (allowed*square[mu]*rate_square));
    }
    return consistent;
}
#else
/* Nothing but quaternions is constrained. */
static bool is_consistent(const parameters_t *parameters, const real q[N], const real v[V])
{
    (void)parameters;
    (void)q;
    (void)v;
    return true;
}
#endif

status_t NAME(start)(const parameters_t *parameters, real q[N], const real velocity[V], real p[N])
{
    status_t status = INVALID;
    real q_start[N];
    real p_start[N];
    if (are_valid(parameters) && is_position(q) && are_finite(V, velocity)) {
        for (int a = 0; a < N; ++a) {
            q_start[a] = q[a];
        }
        normalise_quaternions(q_start);
        if (is_consistent(parameters, q_start, velocity)) {
            momenta_of(parameters, q_start, velocity, p_start);
            status = are_finite(N, p_start) ? OK : SINGULAR;
        }
    }
    if (status == OK) {
        for (int a = 0; a < N; ++a) {
            q[a] = q_start[a];
            p[a] = p_start[a];
        }
    }
    return status;
}

void NAME(velocity)(const parameters_t *parameters, const real q[N], const real p[N],
    real velocity[V])
{
    velocities_of(parameters, q, p, velocity);
}

#endif
