/*
 * A description by hand of a system that is split into flows: an asymmetric body with the torque
 * mgl e3 x R e3, and a point on a line with a spring. toy.h includes it for headers of splitting/.
 *
 *   TOY_SPLITTING   1, and more for template headers that come before:
 *                   2 simd/quadrants.h, 3 sine_cosine.h, 4 rotations.h, 5 flows.h;
 *                   6 with kernels of derivatives, 7 derivatives/splitting.h
 */
#define GS_SPLITTING 1
#define GS_ENGINE 1
#if TOY_CONSTRAINTS > 0
#define GS_CONSTRAINED 1
#endif
#define NAME(function) toy_##function
#define MATH(function) function
#define LIMIT(name) DBL_##name
typedef double real;

enum { N = 5, M = 1, MULTIPLIERS = 0, ROOM = 1, INPUTS = 1, OBSERVED_STEPS = 16,
    OBSERVED_EVERY = 32 };
enum { BODIES = 1, AXES = 1, FURTHER = 1, FREE = 1, Y = 4, KICKED = 3, STAGES = 1,
    COMPOSITIONS = 2 };

typedef struct {
    real I1, I2, I3, mgl, k, u, time;
} toy_parameters;

typedef struct {
    real I1, I2, I3, mgl, k, u, _t, _dt;
} toy_constants;

typedef struct {
    real tolerance;
    int max_iterations, solver;
} toy_options;

typedef struct {
    long steps, iterations;
    int iterations_max;
    long newton_steps, recorded;
    real work, work_low, energy_start, energy_error_max, energy_error_sum;
    real constraint_max, constraint_sum, hidden_max, hidden_sum;
} toy_report;

#define FLOW_TYPES(number, prefix) \
    typedef struct { \
        number q[N], q_low[N], y[Y], y_low[Y], work, work_low; \
    } prefix##flow_state; \
    typedef struct { \
        prefix##flow_state now; \
        number h, t, drift[STAGES + 2], kick[STAGES], gradient[STAGES], kick_time[STAGES]; \
        number sphere[1], axis_rate[1], axis_offset[1], further_rate[1], further_offset[1]; \
        number drag[2], axis[1][3], further_axis[1][3], cosine[1][STAGES + 2]; \
        number space_cosine[1][STAGES + 2], space_vector[1][STAGES + 2][3]; \
        number sine[1][STAGES + 2], elapsed[2][STAGES + 2], decay[2][STAGES + 2]; \
        int stages, is_symmetric, is_underway; \
    } prefix##flows;

FLOW_TYPES(real, )
enum { FLOW_NUMBERS = (sizeof(flows) - 3*sizeof(int))/sizeof(real) };

#if defined(GS_PROFILE_CONTROL)
#include "control.h"
typedef struct {
    int64_t steps;
    uint32_t begun;
    real start_time, q[N], p[N];
    toy_constants constants;
    flows flows;
} toy_work;
#else
typedef struct {
    toy_constants constants;
    real t, step;
    unsigned char memory[1 << 14];
    struct {
        toy_options options;
        toy_report report;
        real dt, start, q[N], p[N];
        int state_changed;
    } simulation;
} toy_work;

typedef struct {
    unsigned char memory[1 << 18];
} toy_batch;
#endif

#include "gyrospark/engine.h"

static const int body_q[1][4] = { { 0, 1, 2, 3 } }, body_axis[1] = { 0 }, axis_which[1] = { 2 };
static const int axis_steady[1] = { 0 }, further_body[1] = { 0 }, further_which[1] = { 1 };
static const int free_q[1] = { 4 }, kicked[3] = { 0, 1, 3 };
#if GS_ROTATING_AXES
enum { SPACES = 1, SPACE_POINTS = 1 };
static const int body_space[1] = { 0 }, space_of_point[1] = { 0 };
static const int space_point_q[1][3] = { { 4, 4, -1 } }, space_point_y[1][3] = { { 3, 3, -1 } };
#endif
static const real half_pi[2] = { 1.5707963267948966, 6.123233995736766e-17 };

typedef struct {
    int stages;
    real drift[STAGES + 1][2], kick[STAGES][2], time[STAGES][2], gradient[STAGES];
} composition_t;
static const composition_t compositions[COMPOSITIONS] = {
    { 1, { { 0.5, 0 }, { 1, 0 } }, { { 1, 0 } }, { { 0.5, 0 } }, { 0 } },
    { 1, { { 0.5, 0 }, { 1, 0 } }, { { 1, 0 } }, { { 0.5, 0 } }, { 0 } },
};

typedef constants flow_constants;
static inline void prepare(const parameters_t *par, constants *c)
{
    *c = (constants){ par->I1, par->I2, par->I3, par->mgl, par->k, par->u, par->time, 0 };
}

static inline real start_time(const parameters_t *par)
{
    return par->time;
}

static inline real time_of(const parameters_t *par, const real *t, long i)
{
    return t == NULL ? par->time : t[i];
}

static inline void set_inputs(constants *c, const real *u)
{
    c->u = u[0];
}

static inline constants *at_time(constants *c, real t)
{
    c->_t = t;
    return c;
}

static inline void flow_rates(const constants *c, real *sphere, real *axis_rate, real *axis_offset,
    real *further_rate, real *further_offset, real *drag)
{
    sphere[0] = 1/c->I1;
    axis_rate[0] = 1/c->I3 - 1/c->I1;
    further_rate[0] = 1/c->I2 - 1/c->I1;
    axis_offset[0] = further_offset[0] = drag[0] = drag[1] = 0;
}

#if GS_ROTATING_AXES
static inline void space_rates(const constants *c, real omega[1][3])
{
    omega[0][0] = omega[0][1] = 0;
    omega[0][2] = c->k;
}
#endif

static inline void axis_directions(const constants *c, real axis[1][3], real further[1][3])
{
    (void)c;
    for (int i = 0; i < 3; ++i) {
        axis[0][i] = i == 2;
        further[0][i] = i == 1;
    }
}

#if GS_PROFILE_CONTROL || GS_PROFILE_RUN
#define INLINE static inline
INLINE real square_root(real x)
{
    return sqrt(x);
}

INLINE real broadcast(real x)
{
    return x;
}
#else
#include "gyrospark/simd/vector.h"
FLOW_TYPES(lanes, lanes_)
typedef struct {
    lanes I1, I2, I3, mgl, k, u, _t;
    int _used;
} lanes_constants;
typedef lanes_constants lanes_flow_constants;

static inline lanes_constants *lanes_at_time(lanes_constants *c, lanes t)
{
    c->_t = t;
    return c;
}

static inline void set_constants(lanes_constants *to, int i, const constants *from)
{
    lane_set(&to->mgl, i, from->mgl);
}

void lanes_space_rates(const lanes_constants *c, lanes (*omega)[3]);

static inline void get_constants(const lanes_constants *from, int i, constants *to)
{
    to->mgl = lane_get(&from->mgl, i);
}

static inline void lanes_set_inputs(lanes_constants *to, int i, const constants *from)
{
    lane_set(&to->u, i, from->u);
}
#endif

#if TOY_SPLITTING > 5
#define TIMES 0
enum { E = 7, DT0 = 2*N + E - TIMES, DH, Z };
#endif

#if TOY_SPLITTING > 1
#include "gyrospark/simd/quadrants.h"
#include "gyrospark/simd/numbers.h"
#include "split_kernels.h"
#if !GS_PROFILE_CONTROL && !GS_PROFILE_RUN
#include "gyrospark/simd/lanes.h"
#include "split_kernels.h"
#endif
#endif
#if TOY_SPLITTING > 6 && !GS_DERIVATIVES_IN_LANES
typedef _Complex double dual;
FLOW_TYPES(dual, dual_)
typedef struct {
    dual I1, I2, I3, mgl, k, u;
} dual_constants;
typedef dual_constants dual_flow_constants;
#include "gyrospark/derivatives/dual_numbers.h"
void set_dual_constants(dual_constants *to, const constants *from, real unit, const real *slopes);
void dual_flow_rates(const dual_constants *c, dual *sphere, dual *axis_rate, dual *axis_offset,
    dual *further_rate, dual *further_offset, dual *drag);
void dual_axis_directions(const dual_constants *c, dual (*axis)[3], dual (*further)[3]);
void dual_space_rates(const dual_constants *c, dual (*omega)[3]);
#include "gyrospark/simd/duals.h"
#include "split_kernels.h"
#endif
#include "gyrospark/simd/numbers.h"
