/*
 * What headers of derivatives expect beside the toy: sizes and declarations of kernels, which no test
 * calls. TOY_DERIVATIVES says what comes before: 1 nothing, 2 directions.h, 3 the linearisation, 4 the
 * step; nothing guards these templates.
 */
#include "gyrospark/derivatives/lu.h"

#if GS_SPARK
#if GS_PROFILE_CONTROL
#include "gyrospark/spark/rates_by_state.h"
#include "gyrospark/spark/unknowns.h"
#else
#if !GS_ELEMENTS
#include "gyrospark/spark/jacobian.h"
#endif
#include "gyrospark/spark/step_end.h"
#endif
#define TIMES GS_TIME_DEPENDENT
#else
#if GS_PROFILE_CONTROL
#include "gyrospark/midpoint/unknowns.h"
#else
#if !GS_ELEMENTS
#include "gyrospark/midpoint/jacobian.h"
#endif
#include "gyrospark/midpoint/step_end.h"
#endif
#define TIMES (2*GS_TIME_DEPENDENT)
#endif
#if TOY_LANES
#include "gyrospark/simd/lanes.h" /* the header of J is for numbers */
#endif
enum { E = 5 + TIMES, PARAMETERS = 6, CHAIN = 2, DT0 = 2*N + E - TIMES, DH, Z };
static const int chain_constant[CHAIN] = { 0, 1 }, chain_parameter[CHAIN] = { 0, 1 };
static const int input_constant[INPUTS] = { 4 };
void constants_by_parameters(const parameters_t *par, real *chain);

#define STATE const TYPED(constants) *c, const NUMBER *q, const NUMBER *p
#define MEANS const TYPED(constants) *c, const NUMBER *qm, const NUMBER *pm, const NUMBER *dq, \
    const NUMBER *dp, const NUMBER *t
#define MATRICES NUMBER (*qq)[N], NUMBER (*qp)[N], NUMBER (*pq)[N], NUMBER (*pp)[N]

#if GS_LAGRANGIAN
void momentum_by_constants(const constants *c, const real *q, const real *v, real (*b)[E]);
void generalised_force_by_constants(const constants *c, const real *q, const real *v,
    const real *t, real (*R)[E]);
void mean_generalised_force_by_state(const constants *c, const real *qm, const real *dq,
    const real *v0, const real *v1, const real *t, real (*R_q)[N], real (*R_v0)[N],
    real (*R_v1)[N], real (*R_c)[E]);
void velocity_constraint(const constants *c, const real *q, const real *v, real (*f_q)[N],
    real (*f_c)[E]);
#include "gyrospark/derivatives/lagrangian.h"
#else
void TYPED(rates_by_constants)(STATE, const NUMBER *t, NUMBER (*qc)[E], NUMBER (*pc)[E]);
void TYPED(mean_rates_derivative)(MEANS, MATRICES, NUMBER (*qc)[E], NUMBER (*pc)[E]);
void TYPED(hidden_derivative)(STATE, NUMBER (*f_q)[N], NUMBER (*f_p)[N], NUMBER (*f_c)[E]);
#endif
void TYPED(force_by_constants)(const TYPED(constants) *c, const NUMBER *q, const NUMBER *lambda,
    NUMBER (*force_c)[E]);
void TYPED(constraint_by_constants)(const TYPED(constants) *c, const NUMBER *q, NUMBER (*g_c)[E]);
void TYPED(mean_constraint_by_start)(const TYPED(constants) *c, const NUMBER *qm,
    const NUMBER *dq, const NUMBER *lambda, NUMBER (*K)[N], NUMBER (*force_c)[E]);
#if TOY_LANES
void hidden_derivative(const constants *c, const real *q, const real *p, real (*f_q)[N],
    real (*f_p)[N], real (*f_c)[E]);
void constraint_by_constants(const constants *c, const real *q, real (*g_c)[E]);
#define TYPED_AT(c, t) LANES_AT(c, t)
#define TYPED_BETWEEN(c, t, step) LANES_BETWEEN(c, t, step)
#else
#define TYPED_AT(c, t) AT(c, t)
#define TYPED_BETWEEN(c, t, step) BETWEEN(c, t, step)
#endif

#if GS_ELEMENTS
#define MATRICES_OF(f) typedef struct { int forced; } f##_matrices
#define RATES(f, STATES) MATRICES_OF(f); \
    void evaluate_##f(const constants *c, STATES, const real *t, int forced, f##_matrices *m); \
    void f##_times(const f##_matrices *m, const real *to_q, const real *to_p, const real *to_c, \
        real *force, real *velocity); \
    void f##_transposed(const f##_matrices *m, const real *force, const real *velocity, \
        real *q_bar, real *p_bar, real *c_bar)
#define CONSTRAINTS(f, ...) MATRICES_OF(f); \
    void evaluate_##f(const constants *c, __VA_ARGS__, f##_matrices *m); \
    void f##_times(const f##_matrices *m, const real *to_q, const real *to_c, real *out); \
    void f##_transposed(const f##_matrices *m, const real *out, real *q_bar, real *c_bar)
#define ONE_STATE const real *q, const real *p
#define TWO_STATES const real *qm, const real *pm, const real *dq, const real *dp
RATES(rates, ONE_STATE);
RATES(mean_rates, TWO_STATES);
CONSTRAINTS(constraint_value, const real *q);
CONSTRAINTS(constraint_velocity, const real *q, const real *d);
CONSTRAINTS(constraint_force, const real *q, const real *lambda);
CONSTRAINTS(mean_constraint_force, const real *qm, const real *dq, const real *lambda);
#endif

#if TOY_DERIVATIVES > 1
#include "gyrospark/derivatives/directions.h"
#endif
#if TOY_DERIVATIVES > 2
#if GS_ELEMENTS && GS_SPARK
#include "gyrospark/derivatives/spark_elements.h"
#elif GS_ELEMENTS
#include "gyrospark/derivatives/midpoint_elements.h"
#elif GS_SPARK
#include "gyrospark/derivatives/spark_dense.h"
#else
#include "gyrospark/derivatives/midpoint_dense.h"
#endif
#endif
#if TOY_DERIVATIVES > 3
#if GS_SPARK
#include "gyrospark/derivatives/spark.h"
#else
#include "gyrospark/derivatives/midpoint.h"
#endif
#endif

#if TOY_DUALS && !GS_ELEMENTS && !GS_LAGRANGIAN && !GS_DERIVATIVES_IN_LANES
#include "gyrospark/derivatives/dual_numbers.h"
typedef struct {
    dual k, damping, drive, omega, u, _t, _dt;
} dual_constants;
void set_dual_constants(dual_constants *to, const constants *from, real unit, const real *slopes);
void dual_parameters(const parameters_t *from, const real *slopes, real unit, dual *par);
void dual_constants_by_parameters(const dual *par, dual *chain);
const dual_constants *dual_at_time(dual_constants *c, dual t);
const dual_constants *dual_between(dual_constants *c, dual t, dual step);
#include "gyrospark/simd/duals.h"
#undef TYPED_AT
#undef TYPED_BETWEEN
#define TYPED_AT(c, t) dual_at_time(c, t)
#define TYPED_BETWEEN(c, t, step) dual_between(c, t, step)
#if GS_FORCES
void TYPED(hessian)(STATE, const NUMBER *t, MATRICES);
#else
void TYPED(hessian)(STATE, const NUMBER *t, NUMBER (*qq)[N], NUMBER (*pq)[N], NUMBER (*pp)[N]);
#endif
void TYPED(mean_jacobian)(MEANS, MATRICES);
void TYPED(mean_constraint)(const TYPED(constants) *c, const NUMBER *qm, const NUMBER *dq,
    NUMBER (*G)[N]);
void TYPED(mean_curvature)(const TYPED(constants) *c, const NUMBER *qm, const NUMBER *dq,
    const NUMBER *lambda, NUMBER (*K)[N]);
void TYPED(constraint_jacobian)(const TYPED(constants) *c, const NUMBER *q, NUMBER (*G)[N]);
void TYPED(constraint_curvature)(const TYPED(constants) *c, const NUMBER *q,
    const NUMBER *lambda, NUMBER (*K)[N]);
void TYPED(rates_by_constants)(STATE, const NUMBER *t, NUMBER (*qc)[E], NUMBER (*pc)[E]);
void TYPED(mean_rates_derivative)(MEANS, MATRICES, NUMBER (*qc)[E], NUMBER (*pc)[E]);
void TYPED(hidden_derivative)(STATE, NUMBER (*f_q)[N], NUMBER (*f_p)[N], NUMBER (*f_c)[E]);
void TYPED(force_by_constants)(const TYPED(constants) *c, const NUMBER *q, const NUMBER *lambda,
    NUMBER (*force_c)[E]);
void TYPED(constraint_by_constants)(const TYPED(constants) *c, const NUMBER *q, NUMBER (*g_c)[E]);
void TYPED(mean_constraint_by_start)(const TYPED(constants) *c, const NUMBER *qm,
    const NUMBER *dq, const NUMBER *lambda, NUMBER (*K)[N], NUMBER (*force_c)[E]);
#include "gyrospark/derivatives/directions.h"
#if GS_SPARK
#include "gyrospark/derivatives/spark_dense.h"
#include "gyrospark/derivatives/spark.h"
#else
#include "gyrospark/derivatives/midpoint_dense.h"
#include "gyrospark/derivatives/midpoint.h"
#endif
#endif

#if TOY_QUANTITIES
/* One gap, q_2. */
enum { QUANTITIES = 1 };

static inline void quantities_at(const parameters_t *parameters, real t, const real q[N],
    const real p[N], real *out)
{
    (void)parameters, (void)t, (void)p;
    out[0] = q[2];
}

static inline void quantity_rates_at(const parameters_t *parameters, real t, const real q[N],
    const real p[N], const real dq[N], const real dp[N], real dt, real *rates)
{
    (void)parameters, (void)t, (void)q, (void)p, (void)dp, (void)dt;
    rates[0] = dq[2];
}
#endif
