/* One trajectory: stages in lanes (SPARK), unknowns, observation, separately compiled parts. */
#ifndef GS_FIXED_POINT_SINGLE_H
#define GS_FIXED_POINT_SINGLE_H

#include "gyrospark/run/record.h"

#if GS_SPARK
#include "gyrospark/spark/residual.h"

#include "gyrospark/predictor/least_squares.h"

#include "gyrospark/simd/small_lu.h"

#define GS_STAGES_IN_LANES 1
#define SOLVER(f) SINGLE(f)
#define TABLE(name) w->name
#define COEFFICIENT lanes
#define TABLE_PRODUCT PRODUCT

#include "gyrospark/fixed_point/state.h"

#include "gyrospark/fixed_point/constraints.h"

#include "gyrospark/fixed_point/update.h"

#include "gyrospark/fixed_point/work.h"

#include "gyrospark/predictor/select.h"

#if GS_FRAME
#include "gyrospark/frames/relative_equilibrium.h"
#endif

#include "gyrospark/fixed_point/iteration.h"

/* The unknowns (B.2): the scaled unknowns without their weights. */
static void SINGLE(get_unknowns)(const SINGLE(t) *w, real x[U])
{
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a) {
            const int item = i/SINGLE(PER), place = item*N + a, at = i % SINGLE(PER);
            const lanes *h_b = &w->h_b[item], *h_b_hat = &w->h_b_hat[item];
            x[i*N + a] = lane_get(&w->now.x[place], at)/lane_get(h_b, at);
            x[K_HAT + i*N + a] = lane_get(&w->now.x[SINGLE(HAT) + place], at)/lane_get(h_b_hat, at);
        }
#if GS_CONSTRAINED
    real multipliers[ROOM];
    SINGLE(multipliers)(w, 0, multipliers);
    for (int l = 0; l < P*M; ++l)
        x[LAMBDA + l] = multipliers[l];
#endif
}

#undef GS_STAGES_IN_LANES
#undef SOLVER
#undef TABLE
#undef COEFFICIENT
#undef TABLE_PRODUCT
#else
#include "gyrospark/midpoint/fixed_point.h"
#endif

/* Number of distinct lanes: those of stages or nodes, or one; the others are padding. */
static int SINGLE(used_lanes)(void)
{
    const int most = S > P ? S : P;
    return most < LANES ? most : LANES;
}

/* Sum over the stages of the trajectory, one in each lane; or its value, in all lanes. */
INLINE real SINGLE(sum_lanes)(const lanes *x)
{
    real sum = lane_get(x, 0);
#if GS_SPARK
    for (int i = 1; i < LANES; ++i)
        sum += lane_get(x, i);
#endif
    return sum;
}

#if GS_CONSTRAINED
/* Updates the report with |g| and |f| (hidden constraint) at the state. */
static void SINGLE(observe_constraint_errors)(const SINGLE(t) *s, report_t *report)
{
    lanes f[M];
    real g_size = 0, f_size = 0;
    lanes_hidden_constraint(&s->constants, s->q, s->p, f);
    for (int mu = 0; mu < M; ++mu) {
        g_size = larger(MATH(fabs)(lane_get(&s->constraint_state.g_rounded[mu], 0)), g_size);
        f_size = larger(MATH(fabs)(lane_get(&f[mu], 0)), f_size);
    }
    observe_constraint_errors(g_size, f_size, report);
}
#endif

/* ---------------------------------------------------------- functions outside of the iteration */

/*
 * Functions that a run calls at most once a step. They are large, so GYROSPARK_OBJECT 4 compiles
 * them as a separate object, in parallel with the iteration.
 */
#if defined(__GNUC__) && defined(GYROSPARK_OBJECT)
void NAME(object_initialise)(SINGLE(t) *w);
void NAME(object_estimate_round_off)(SINGLE(t) *w);
void NAME(object_record_step)(SINGLE(t) *w);

#if GYROSPARK_OBJECT == 4 /* __GNUC__ */
void NAME(object_initialise)(SINGLE(t) *w)
{
    SINGLE(initialise)(w);
}

void NAME(object_estimate_round_off)(SINGLE(t) *w)
{
    SINGLE(estimate_round_off)(w);
}

void NAME(object_record_step)(SINGLE(t) *w)
{
    SINGLE(record_step)(w);
}
#endif
#endif

#if defined(__GNUC__) && defined(GYROSPARK_OBJECT) && GYROSPARK_OBJECT == 2
#define SEPARATE(f) NAME(object_##f)
#else /* __GNUC__ */
#define SEPARATE(f) SINGLE(f)
#endif

#endif
