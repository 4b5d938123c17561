/* What profile control expects besides, of either system of the toy. */
#ifndef TOY_CONTROL_H
#define TOY_CONTROL_H

#include <stdint.h>

typedef enum { OK, NOT_CONVERGED, SINGULAR, NOT_FINITE, DIVERGED = 5, INVALID } toy_status;

enum { QUATERNIONS = 0 };
static const int quaternion[1][4] = { { 0, 0, 0, 0 } };

static inline bool are_valid(const toy_parameters *par)
{
    return par->k > 0;
}

#if GS_FORCED_BY_TIME
static inline real origin_of(const toy_parameters *par)
{
    return par->time;
}

static inline toy_parameters begun_at(real origin, const toy_parameters *par)
{
    toy_parameters begun = *par;
    begun.time = origin;
    return begun;
}
#endif

/* For profiles/start.h. */
enum { V = N, HELD = 1 };

static inline void momenta_of(const toy_parameters *par, const real *q, const real *v, real *p)
{
    (void)par, (void)q;
    for (int a = 0; a < N; ++a)
        p[a] = v[a];
}

static inline void velocities_of(const toy_parameters *par, const real *q, const real *p, real *v)
{
    momenta_of(par, q, p, v);
}

static inline void start_defects(const toy_parameters *par, const real *q, const real *v,
    real *rate, real *g, real *f, real *square)
{
    momenta_of(par, q, v, rate);
    g[0] = f[0] = square[0] = 0;
}

#endif
