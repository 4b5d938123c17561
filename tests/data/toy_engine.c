/*
 * The interface of the engine, written by hand for a toy: a unit mass in N dimensions on a spring,
 *     H = p.p/2 + k q.q/2,   g_0 = sum s_a q_a^2 - 1 (M > 0),   g_1 = q_0 - q_(N-1) (M > 1).
 * W = G G^T is constant where all s_a are 1 and M = 1. The test puts sizes, tables and the names of
 * the engine's files before and behind this.
 */
#include <float.h>
#include <math.h>
#include <stddef.h>

#define NAME(function) toy_##function
#define MATH(function) function
#define LIMIT(limit) DBL_##limit
#define ON(function) function
#define NUMBER real
#define ONE(name) ONE_(name)
#define MANY(name) MANY_(name)
#define TURNED(call)
#define CARRIED(call)
#define AT(c, t) (c)
#define BETWEEN(c, t, late) (c)
#define LANES_AT(c, t) (c)
#define LANES_BETWEEN(c, t, late) (c)
#define TIMED(...)
#define INPUT(...)

typedef double real;
typedef struct { real k; } parameters_t;
typedef struct { real k; } constants;
typedef struct { real tolerance; int max_iterations, solver; } options_t;
typedef struct {
    long steps, iterations;
    int iterations_max;
    long newton_steps;
    real energy_start, energy_error_max, energy_error_sum;
    real constraint_max, constraint_sum, hidden_max, hidden_sum;
} report_t;
enum { MS = M > 0 ? M : 1, ROOM = (P + 1)*MS, MULTIPLIERS = STAGES ? (P + 1)*M : M };
enum { U = STAGES ? 2*N*S + M*P : 2*N + M };
typedef struct {
    constants constants;
    real x[U], r[U], x_near[U], r_near[U], increment;
    long products, effort;
    real J[U*U];
    int exponents[U], pivots[U];
    real t;
    real stage_q[S][N], stage_p[S][N], D[P + 1][N], Q_tilde[P + 1][N], force[P][N];
    real G[P + 1][MS][N], K[P][N][N], q_mean[N], p_mean[N];
    unsigned char memory[1 << 18];
} work_t;
typedef struct { unsigned char memory[1 << 18]; } batch_memory;
enum { OK, NOT_CONVERGED, SINGULAR, NOT_FINITE, STAGNATED, DIVERGED };
enum { NEWTON = 1, FIXED_POINT };
enum { RESIDUAL_COST = U*U, JACOBIAN_COST = U*U*U };

static const real epsilon = DBL_EPSILON;

#define UNUSED __attribute__((unused)) static inline

UNUSED void prepare(const parameters_t *par, constants *c)
{
    c->k = par->k;
}

UNUSED real start_time(const parameters_t *par)
{
    (void)par;
    return 0;
}

/* Each kernel once, for numbers and for lanes: TYPE, PRE(name), C and ZERO say which. */
#define KERNELS(TYPE, PRE, C, ZERO) \
UNUSED TYPE PRE(hamiltonian)(const C *c, const TYPE *q, const TYPE *p) \
{ \
    TYPE sum = ZERO; \
    for (int a = 0; a < N; ++a) \
        sum += p[a]*p[a]/2 + c->k*q[a]*q[a]/2; \
    return sum; \
} \
UNUSED void PRE(constraint)(const C *c, const TYPE *q, TYPE *g) \
{ \
    (void)c; \
    if (M > 0) { \
        g[0] = ZERO - 1; \
        for (int a = 0; a < N; ++a) \
            g[0] += squares[a]*q[a]*q[a]; \
    } \
    if (M > 1) \
        g[1] = q[0] - q[N - 1]; \
} \
UNUSED void PRE(constraint_increment)(const C *c, const TYPE *q, const TYPE *d, TYPE *dg) \
{ \
    (void)c; \
    if (M > 0) { \
        dg[0] = ZERO; \
        for (int a = 0; a < N; ++a) \
            dg[0] += squares[a]*d[a]*(2*q[a] + d[a]); \
    } \
    if (M > 1) \
        dg[1] = d[0] - d[N - 1]; \
} \
UNUSED void PRE(constraint_jacobian)(const C *c, const TYPE *q, TYPE G[MS][N]) \
{ \
    (void)c; \
    for (int a = 0; a < N; ++a) { \
        G[0][a] = 2*squares[a]*q[a]; \
        if (M > 1) \
            G[M - 1][a] = ZERO + (a == 0 ? 1 : a == N - 1 ? -1 : 0); \
    } \
} \
UNUSED void PRE(hidden_constraint)(const C *c, const TYPE *q, const TYPE *p, TYPE *f) \
{ \
    TYPE G[MS][N]; \
    PRE(constraint_jacobian)(c, q, G); \
    for (int mu = 0; mu < M; ++mu) { \
        f[mu] = ZERO; \
        for (int a = 0; a < N; ++a) \
            f[mu] += G[mu][a]*p[a]; \
    } \
} \
UNUSED void PRE(hidden_matrix)(const C *c, const TYPE *q, const TYPE *p, TYPE W[MS][MS]) \
{ \
    TYPE G[MS][N]; \
    (void)p; \
    PRE(constraint_jacobian)(c, q, G); \
    for (int mu = 0; mu < M; ++mu) \
        for (int nu = 0; nu < M; ++nu) { \
            W[mu][nu] = ZERO; \
            for (int a = 0; a < N; ++a) \
                W[mu][nu] += G[mu][a]*G[nu][a]; \
        } \
} \
UNUSED void PRE(mean_constraint)(const C *c, const TYPE *qm, const TYPE *dq, TYPE G[MS][N]) \
{ \
    (void)dq; \
    PRE(constraint_jacobian)(c, qm, G); \
}

#define ALONE(name) name
KERNELS(real, ALONE, constants, 0)

UNUSED void gradient(const constants *c, const real *q, const real *p, const real *t, real *H_q,
    real *H_p)
{
    (void)t;
    for (int a = 0; a < N; ++a) {
        H_q[a] = c->k*q[a];
        H_p[a] = p[a];
    }
}

UNUSED void hessian(const constants *c, const real *q, const real *p, const real *t,
    real H_qq[N][N], real H_pq[N][N], real H_pp[N][N])
{
    (void)q, (void)p, (void)t;
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b) {
            H_qq[a][b] = a == b ? c->k : 0;
            H_pq[a][b] = 0;
            H_pp[a][b] = a == b;
        }
}

UNUSED void constraint_curvature(const constants *c, const real *q, const real *lambda,
    real K[N][N])
{
    (void)c, (void)q;
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b)
            K[a][b] = a == b ? 2*squares[a]*lambda[0] : 0;
}

UNUSED void mean_gradient(const constants *c, const real *qm, const real *pm, const real *dq,
    const real *dp, const real *t, real *D_q, real *D_p)
{
    (void)dq, (void)dp;
    gradient(c, qm, pm, t, D_q, D_p);
}

UNUSED void mean_jacobian(const constants *c, const real *qm, const real *pm, const real *dq,
    const real *dp, const real *t, real D_qq[N][N], real D_qp[N][N], real D_pq[N][N],
    real D_pp[N][N])
{
    (void)dq, (void)dp;
    hessian(c, qm, pm, t, D_qq, D_pq, D_pp);
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b) {
            D_qq[a][b] /= 2;
            D_pp[a][b] /= 2;
            D_qp[a][b] = 0;
        }
}

UNUSED void mean_curvature(const constants *c, const real *qm, const real *dq, const real *lambda,
    real K[N][N])
{
    (void)dq;
    constraint_curvature(c, qm, lambda, K);
    for (int a = 0; a < N; ++a)
        K[a][a] /= 2;
}

#include "lanes_of_vectors.h"
#include "lanes.h"

typedef struct {
    lanes k;
    int _used;
} lane_constants;

UNUSED void set_constants(lane_constants *to, int i, const constants *from)
{
    set_part(&to->k, i, from->k);
}

UNUSED void get_constants(const lane_constants *from, int i, constants *to)
{
    to->k = part(&from->k, i);
}

#define ON_LANES(name) lanes_##name
KERNELS(lanes, ON_LANES, lane_constants, splat(0))

UNUSED void lanes_schur(const lane_constants *c, const lanes *q, const lanes *p, lanes W[MS][MS])
{
    lanes_hidden_matrix(c, q, p, W); /* H_pp = 1, and f = G H_p has no factor */
}

UNUSED void lanes_schur_inverse(const lane_constants *c, lanes W_inverse[MS][MS])
{
    (void)c;
    W_inverse[0][0] = splat((real)0.25); /* |G|^2 = 4 on the sphere */
}

UNUSED lanes lanes_correction(const lane_constants *c)
{
    (void)c;
    return splat(1);
}

UNUSED void first_rates(const lane_constants *c, const lanes *q, const lanes *p, lanes *H_p,
    lanes *w)
{
    (void)c, (void)q, (void)w;
    for (int a = 0; a < N; ++a)
        H_p[a] = p[a];
}

UNUSED void second_rates(const lane_constants *c, const lanes *q, const lanes *p, const lanes *t,
    const lanes *w, lanes *H_p, lanes *H_q)
{
    (void)t, (void)w;
    for (int a = 0; a < N; ++a) {
        H_p[a] = p[a];
        H_q[a] = c->k*q[a];
    }
}

UNUSED void lanes_mean_velocity(const lane_constants *c, const lanes *qm, const lanes *pm,
    const lanes *dq, const lanes *dp, lanes *D_p)
{
    (void)dq, (void)dp;
    first_rates(c, qm, pm, D_p, NULL);
}

UNUSED void lanes_mean_force(const lane_constants *c, const lanes *qm, const lanes *pm,
    const lanes *dq, const lanes *dp, const lanes *t, lanes *D_q)
{
    lanes H_p[N];
    (void)dq, (void)dp;
    second_rates(c, qm, pm, t, NULL, H_p, D_q);
}

enum { SHARED = 1, ROUNDS = 1 };
#define PRODUCT INLINE
