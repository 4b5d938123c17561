/*
 * A description of a system by hand, in place of a generated file: what the headers of the engine
 * expect, with features and sizes from the command line. An editor and the tests include it before
 * a header (-include); engine/README.md lists its parts.
 *
 * A particle of mass 1 in N dimensions on a spring, in a frame that rotates with the rate omega:
 *     H = p.p/2 + (k + drive t) q.q/2 - u q_0,    F = -damping p,
 *     g_0 = sum_a squares_a q_a^2 - 1,            g_1 = q_0 - q_(N-1),    J = q_0 p_1 - q_1 p_0.
 * W = G G^T is constant where all squares are 1 and M = 1; then H_pp G^T = G^T.
 *
 *   TOY_CONSTRAINTS   M = 0, 1 or 2
 *   TOY_STAGES        s of G-L; 0 for the midpoint scheme
 *   TOY_SQUARES       squares of the first constraint
 *   TOY_TABLES        a file with the tables of the method
 *   TOY_LEGENDRE, TOY_ELIMINATION, TOY_CONVERGENCE
 *                     0 where lagrangian/legendre.h, linear_algebra/block_elimination.h or
 *                     fixed_point/convergence.h comes next: nothing guards a template header
 *   TOY_DECLARED      1 for frames/trajectory.h: functions of run/begin_advance.h come before it
 *   TOY_LANES         1: template headers work on lanes, 0: on numbers
 *   TOY_SINGLE        1: template headers are of one trajectory, 0: of a batch
 *   TOY_DERIVATIVES   above 0 for headers of derivatives: see derivatives.h
 *   TOY_SPLITTING     above 0 for headers of splitting: see splitting.h, another system
 *   TOY_QUANTITIES    1 for run/impacts.h: one gap
 *   TOY_DUALS         1: dual numbers, with what works on them
 *   TOY_BEFORE        template headers that come before: 1 state.h, 2 constraints.h, 3 update.h,
 *                     4 work.h, 5 select.h
 */
#ifndef TOY_H
#define TOY_H

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#ifndef TOY_SPLITTING
#define TOY_SPLITTING 0
#endif

#ifndef TOY_CONSTRAINTS
#define TOY_CONSTRAINTS 1
#endif
#if TOY_SPLITTING
#include "splitting.h"
#else

#ifndef TOY_STAGES
#define TOY_STAGES 2
#endif
#ifndef TOY_SQUARES
#define TOY_SQUARES 1, 2, 4
#endif
#ifndef TOY_TABLES
#define TOY_TABLES "tables.h"
#endif
#ifndef TOY_LEGENDRE
#define TOY_LEGENDRE 1
#endif
#ifndef TOY_ELIMINATION
#define TOY_ELIMINATION 1
#endif
#ifndef TOY_CONVERGENCE
#define TOY_CONVERGENCE 1
#endif
#ifndef TOY_DECLARED
#define TOY_DECLARED 0
#endif
#ifndef TOY_LANES
#define TOY_LANES 0
#endif
#ifndef TOY_DERIVATIVES
#define TOY_DERIVATIVES 0
#endif
#ifndef TOY_DUALS
#define TOY_DUALS 0
#endif
#ifndef TOY_BEFORE
#define TOY_BEFORE 0
#endif

#if TOY_DERIVATIVES && TOY_LANES && !defined(GS_DERIVATIVES_IN_LANES)
#define GS_DERIVATIVES_IN_LANES 1
#elif defined(GS_DERIVATIVES_IN_LANES)
#undef TOY_LANES
#define TOY_LANES 1
#endif

#if TOY_DERIVATIVES
#define GS_DERIVATIVES 1
#endif
#if defined(GS_TIME_DEPENDENT) && !defined(GS_FORCES) && TOY_STAGES > 0
#define GS_FORCES 1 /* rheonomic constraints do work */
#endif
#define GS_ENGINE 1
#if TOY_CONSTRAINTS > 0
#define GS_CONSTRAINED 1
#endif
#if TOY_CONSTRAINTS > 1
#define GS_SEVERAL_CONSTRAINTS 1
#endif
#if TOY_STAGES > 0
#define GS_SPARK 1
#endif
#if !defined(GS_PROFILE_RUN) && !defined(GS_PROFILE_CONTROL) && !defined(GS_FIXED_POINT) \
    && !defined(GS_VELOCITY_CONSTRAINTS)
#define GS_FIXED_POINT 1
#endif
#if TOY_CONSTRAINTS > 0 && (TOY_STAGES > 0 || !defined(GS_CONSTANT_SCHUR))
#define GS_FACTORS 1
#endif
#define NAME(function) toy_##function
#define MATH(function) function
#define LIMIT(name) DBL_##name
#define KERNEL(function) function
typedef double real;
typedef _Complex double dual;

enum { N = 3, M = TOY_CONSTRAINTS };
enum { S = TOY_STAGES > 0 ? TOY_STAGES : 1, P = S };
#ifdef GS_VELOCITY_CONSTRAINTS
enum { ROWS = 1, MULTIPLIERS = (P + 1)*M + S*ROWS, U = 2*N*S + MULTIPLIERS };
#else
enum { MULTIPLIERS = TOY_STAGES > 0 ? (P + 1)*M : M };
enum { U = TOY_STAGES > 0 ? 2*N*S + M*P : 2*N + M };
#endif
enum { ROOM = MULTIPLIERS > 0 ? MULTIPLIERS : 1 };
enum { ORDERS = 4, HISTORY = 32, INPUTS = 1 };
enum { RESIDUAL_COST = U*U, JACOBIAN_COST = U*U*U, ITERATION_COST = 10*U };

/* ----------------------------------------------------------------- types of the public header */

typedef struct {
    real k, damping, drive, omega, u, time;
} toy_parameters;

typedef struct {
    real k, damping, drive, omega, u;
    real _t, _dt;
    real W_inverse[M > 0 ? M : 1][M > 0 ? M : 1], correction; /* of profiles control and run */
} toy_constants;

typedef struct {
    real tolerance;
    int max_iterations, solver;
} toy_options;

typedef struct {
    long steps, iterations;
    int iterations_max;
    long newton_steps;
    real work, work_low, energy_start, energy_error_max, energy_error_sum;
    real constraint_max, constraint_sum, hidden_max, hidden_sum;
} toy_report;

#if defined(GS_PROFILE_CONTROL)
#include "control.h"
#endif

/* Profiles control and run: the state of the fixed-point iteration. */
enum { UNKNOWNS_OF_STATE = TOY_STAGES > 0 ? 2*N*S + P*M : 2*N + M };
typedef struct {
    toy_constants constants;
    real tolerance;
    int max_iterations;
    real h, h_inverse, t, q[N], p[N], q_low[N], p_low[N], q_weight, p_weight, change, defect;
    int iterations, history_length, order;
    real x[UNKNOWNS_OF_STATE], history[ORDERS][UNKNOWNS_OF_STATE], g[M + 1], row_weight[M + 1];
    real factors[P][M > 0 ? M : 1][M > 0 ? M : 1], D[P*N], Y[P*N], C[S*N];
#if defined(GS_PROFILE_CONTROL)
    real start_time;
    int64_t steps;
    uint32_t begun;
} toy_work;
#else
} toy_state;

typedef struct {
    toy_constants constants;
    real x[U], r[U], x_near[U], r_near[U], increment;
    long products, effort;
    real J[U*(4*U + 1)];
    int exponents[U], pivots[3*U], rows[U];
    real forward[U], t, step, node_time[P + 1], work_done, frame_q[N], frame_p[N];
    real stage_q[S][N], stage_p[S][N], D[P + 1][N], force[P + 1][N], Q_tilde[P + 1][N];
    real differences[8][U];
    int stored, order, has_factors;
    real G[P + 1][M > 0 ? M : 1][N], K[P + 1][N][N], q_mean[N], p_mean[N];
    toy_state state;
    int failures, newton_steps_left;
    unsigned char memory[1 << 18];
    struct {
        toy_options options;
        toy_report report;
        real dt, start, q[N], p[N];
        int state_changed;
        toy_parameters frame_parameters;
        long frame_start;
    } simulation;
} toy_work;

typedef struct {
    unsigned char memory[1 << 18];
} toy_batch;
#endif

#include "gyrospark/engine.h"

static const real squares[N] = { TOY_SQUARES };

#if GS_SPARK
#include TOY_TABLES
#endif

/* ----------------------------------------------------------------------- kernels on numbers */

static inline void prepare(const parameters_t *par, constants *c)
{
    *c = (constants){ par->k + par->drive*par->time, par->damping, par->drive, par->omega, par->u,
        0, 0, { { 0 } }, 1 }; /* kernels count time from the start of a run */
    c->W_inverse[0][0] = 0.25; /* |G|^2 = 4 on the sphere */
}

static inline real start_time(const parameters_t *par)
{
    (void)par;
    return 0;
}

static inline real time_of(const parameters_t *par, const real *t, long i)
{
    return t == NULL ? 0 : t[i] - par->time;
}

static inline void set_inputs(constants *c, const real *u)
{
    c->u = u[0];
}

#include "gyrospark/simd/numbers.h"
#include "kernels.h"

#if GS_VELOCITY_CONSTRAINTS
/* z' - x y' = 0, which no function of q implies */
static inline void velocity_rows(const constants *c, const real *q, real A[ROWS][N])
{
    (void)c;
    A[0][0] = 0;
    A[0][1] = -q[0];
    A[0][2] = 1;
}

static inline void reaction_curvature(const constants *c, const real *q, const real *mu,
    real K[N][N])
{
    (void)c, (void)q;
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b)
            K[a][b] = a == 1 && b == 0 ? -mu[0] : 0;
}

static inline void velocity_defect(const constants *c, const real *q, const real *v, real *f)
{
    (void)c;
    f[M] = v[2] - q[0]*v[1];
#if GS_CONSTRAINED
    real G[M][N];
    constraint_jacobian(c, q, G);
    for (int mu = 0; mu < M; ++mu) {
        f[mu] = 0;
        for (int a = 0; a < N; ++a)
            f[mu] += G[mu][a]*v[a];
    }
#endif
}

static inline void velocity_defect_by_q(const constants *c, const real *q, const real *v,
    real D[M + ROWS][N])
{
    (void)c, (void)q;
    for (int a = 0; a < N; ++a) {
        for (int mu = 0; mu < M; ++mu)
            D[mu][a] = mu == 0 ? 2*squares[a]*v[a] : 0;
        D[M][a] = a == 0 ? -v[1] : 0;
    }
}
#endif

#if GS_ELEMENTS
/* W without its zeros: here there are none. The diagonal, then the column below it. */
enum { FACTOR = M*(M + 1)/2, LARGEST_CELL = N, BAND = U - 1 };
static const int pivot_order[2] = { 0, 1 }, pivot_rows[2] = { M - 1, 0 };
static const int below_row[1] = { 1 }, below_target[1] = { 0 };
static const int before_rows[2] = { 0, 1 }, before_row[1] = { 0 }, before_slot[1] = { 2 };
static const int position[U] = { 0 }; /* of unknown 0; no step is made with these */
static const int cell_count[N] = { 1, 1, 1 }, cell_first[N] = { 0, 1, 2 };
static const int cell_row[N] = { 0, 1, 2 }, mixed_first[N + 1] = { 0 }, mixed_row[1] = { 0 };

void jacobian(work_t *w, real dt, const real q[N], const real p[N], const real x[U], real *J);
void constraint_reach(const constants *c, const real *q, real *reach);
void schur(const constants *c, const real *q, const real *p, real *W);
void gram(const constants *c, const real *q, real *W);
#if TOY_ELIMINATION
#include "gyrospark/linear_algebra/block_elimination.h"
#endif
#endif

#if GS_FRAME
typedef real wide_real;
#define WIDE_MATH(function) function
enum { ANGLES = 1, AXES = 1 };
static const wide_real quarter[3] = { 1.5707963267948966, 6.123233995736766e-17,
    -1.4973849048591833e-33 };
static const int rotation_group[N] = { 0, 0, 2 };
enum { RATES_STAY_ZERO = 1 };
#include "gyrospark/linear_algebra/double_word.h"

static inline void frame_rates(const parameters_t *par, double_word rate[ANGLES], real axis[AXES])
{
    rate[0] = (double_word){ par->omega, 0 };
    axis[0] = 0;
}

/* x of the rotating frame, in the frame at rest */
static inline void rotate_coordinates(const parameters_t *par, const real *cosine,
    const real *sine, const real *axis, const real x[N], real y[N])
{
    (void)par, (void)axis;
    y[0] = cosine[0]*x[0] - sine[0]*x[1];
    y[1] = sine[0]*x[0] + cosine[0]*x[1];
    y[2] = x[2];
}

static inline void rotate_momenta(const parameters_t *par, const real *cosine, const real *sine,
    const real *axis, const real x[N], real y[N])
{
    rotate_coordinates(par, cosine, sine, axis, x, y);
}

static inline void rotate_multipliers(const parameters_t *par, const real *cosine,
    const real *sine, const real *axis, const real *x, real *y)
{
    (void)par, (void)cosine, (void)sine, (void)axis;
    for (int mu = 0; mu < M; ++mu)
        y[mu] = x[mu];
}

#if TOY_DECLARED
void set_state(work_t *w, const real q[N], const real p[N]);
void reset_iteration(work_t *w);
#endif
#endif

/* ------------------------------------------------------------------------- kernels on lanes */

#if !GS_PROFILE_RUN && !GS_PROFILE_CONTROL
#include "gyrospark/simd/vector.h"

typedef struct {
    lanes k, damping, drive, omega, u;
    lanes _t, _dt;
    int _used;
} lanes_constants;

static inline void set_constants(lanes_constants *to, int i, const constants *from)
{
    lane_set(&to->k, i, from->k);
    lane_set(&to->damping, i, from->damping);
    lane_set(&to->drive, i, from->drive);
    lane_set(&to->omega, i, from->omega);
    lane_set(&to->u, i, from->u);
    lane_set(&to->_t, i, from->_t);
    lane_set(&to->_dt, i, from->_dt);
}

static inline void get_constants(const lanes_constants *from, int i, constants *to)
{
    *to = (constants){ lane_get(&from->k, i), lane_get(&from->damping, i),
        lane_get(&from->drive, i), lane_get(&from->omega, i), lane_get(&from->u, i),
        lane_get(&from->_t, i), lane_get(&from->_dt, i), { { 0.25 } }, 1 };
}

static inline void lanes_set_inputs(lanes_constants *to, int i, const constants *from)
{
    lane_set(&to->u, i, from->u);
}

#include "gyrospark/simd/lanes.h"
#include "kernels.h"

#if GS_ELEMENTS && GS_CONSTRAINED
void lanes_constraint_change(const lanes_constants *c, const lanes *q, const lanes *d,
    lanes *change, lanes *squared);
void lanes_schur(const lanes_constants *c, const lanes *q, const lanes *p, lanes *W);
#if TOY_ELIMINATION
#include "gyrospark/linear_algebra/block_elimination.h"
#endif
#endif

#if GS_LAGRANGIAN && TOY_LEGENDRE
#include "gyrospark/lagrangian/rates.h"
#endif
#if !GS_LAGRANGIAN
enum { SHARED = 1, ROUNDS = 1 };

static inline void first_rates(const lanes_constants *c, const lanes *q, const lanes *p,
    lanes *H_p, lanes *shared)
{
    shared[0] = splat(0);
    lanes_velocity(c, q, p, H_p);
}

static inline void second_rates(const lanes_constants *c, const lanes *q, const lanes *p,
    const lanes *t, const lanes *shared, lanes *H_p, lanes *H_q)
{
    (void)t, (void)shared;
    lanes_velocity(c, q, p, H_p);
    lanes_force(c, q, p, H_q);
}
#endif
#define PRODUCT INLINE
#if TOY_CONVERGENCE
#include "gyrospark/simd/numbers.h"
#include "gyrospark/fixed_point/convergence.h"
#include "gyrospark/simd/lanes.h"
#include "gyrospark/fixed_point/convergence.h"
#endif
#else
enum { SHARED = 1, ROUNDS = 1 };

static inline void first_rates(const constants *c, const real *q, const real *p, real *H_p,
    real *shared)
{
    shared[0] = 0;
    velocity(c, q, p, H_p);
}

static inline void second_rates(const constants *c, const real *q, const real *p, const real *t,
    const real *shared, real *H_q)
{
    (void)t, (void)shared;
    force(c, q, p, H_q);
}
#endif

/* --------------------------------------------------------- the surroundings of template headers */

#include "gyrospark/simd/numbers.h"
#if TOY_LANES
#include "gyrospark/simd/lanes.h"
#endif
#ifdef TOY_SINGLE
#define GS_STAGES_IN_LANES TOY_SINGLE
#if TOY_SINGLE
#define SOLVER(f) SINGLE(f)
#define TABLE(name) w->name
#define COEFFICIENT lanes
#define TABLE_PRODUCT PRODUCT
#else
#define SOLVER(f) BATCH(f)
#define TABLE(name) &table_##name[0][0]
#define COEFFICIENT real
#define TABLE_PRODUCT NOINLINE
#endif
#include "gyrospark/spark/residual.h"
#include "gyrospark/predictor/least_squares.h"
#include "gyrospark/simd/small_lu.h"
#if TOY_BEFORE > 0
#include "gyrospark/fixed_point/state.h"
#endif
#if TOY_BEFORE > 1
#include "gyrospark/fixed_point/constraints.h"
#endif
#if TOY_BEFORE > 2
#include "gyrospark/fixed_point/update.h"
#endif
#if TOY_BEFORE > 3
#include "gyrospark/fixed_point/work.h"
#endif
#if TOY_BEFORE > 4
#include "gyrospark/predictor/select.h"
#endif
#endif

#if TOY_DERIVATIVES
#include "derivatives.h"
#endif

#endif
#endif
