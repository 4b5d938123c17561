/* A stepper of the toy, and calls of functions that a stepper keeps to itself, for tests. */
#include "toy.h"

#if GS_PROFILE_CONTROL
#include "gyrospark/profiles/control.h"
#else
#include "gyrospark/newton/step.h"
#endif

#if GS_FIXED_POINT
#include "gyrospark/linear_algebra/product_sums.h"
#include "gyrospark/run/batch.h"
#include "gyrospark/run/crossings.h"

int toy_converges(int count, const real *change, const real *defect, real tolerance,
    int max_iterations, int *failed);
void toy_converges_lanes(int count, const real *change, const real *defect, real tolerance,
    int max_iterations, int *ended, int *failed);
void toy_predict(int steps, const real *values, real *predicted);
void toy_product_sum(int rows, int count, const real *factors, real sum[2]);
void toy_crossings(long count, const real *values, real level, real last[2], long rows[2]);
void toy_masks(const real *a, const real *b, const real *x, const real *y, real *out);

/* The iteration that ends a sequence of changes and defects, squares; 0: none does. */
int toy_converges(int count, const real *change, const real *defect, real tolerance,
    int max_iterations, int *failed)
{
    progress_t progress = initial_progress();
    real rates[RATES + 1];
    for (int i = 0; i <= RATES; ++i)
        rates[i] = 1;
    for (int i = 0; i < count; ++i) {
        const convergence_t result = test_convergence(&progress, change[i], defect[i], 1,
            tolerance, max_iterations, 1, rates + rate_index(i + 1));
        *failed = result.failed;
        if (result.ended)
            return i + 1;
    }
    return 0;
}

/* The same on lanes: rows of LANES numbers. */
void toy_converges_lanes(int count, const real *change, const real *defect, real tolerance,
    int max_iterations, int *ended, int *failed)
{
    lanes_progress_t progress = lanes_initial_progress();
    lanes rates[RATES + 1];
    for (int i = 0; i <= RATES; ++i)
        rates[i] = splat(1);
    for (int lane = 0; lane < LANES; ++lane)
        ended[lane] = failed[lane] = 0;
    for (int i = 0; i < count; ++i) {
        lanes changes = splat(0), defects = splat(0);
        for (int lane = 0; lane < LANES; ++lane) {
            lane_set(&changes, lane, change[i*LANES + lane]);
            lane_set(&defects, lane, defect[i*LANES + lane]);
        }
        const lanes_convergence_t result = lanes_test_convergence(&progress, changes, defects,
            splat(1), tolerance, max_iterations, 1, rates + rate_index(i + 1));
        for (int lane = 0; lane < LANES; ++lane)
            if (ended[lane] == 0 && mask_get(&result.ended, lane)) {
                ended[lane] = i + 1;
                failed[lane] = mask_get(&result.failed, lane);
            }
    }
}

/* What the recurrence predicts of three series, before it learns of each value. */
void toy_predict(int steps, const real *values, real *predicted)
{
    const int ends[GROUPS] = { 1, 2, 3 }, rows[GROUPS] = { 1, 1, 1 };
    static lanes history[HISTORY*GROUPS];
    static predictor_t predictor;
    lanes x[GROUPS], extrapolated[GROUPS];
    reset_predictor(&predictor);
    for (int e = 0; e < GROUPS; ++e)
        extrapolated[e] = splat((real)HUGE_VAL); /* of no use */
    for (int i = 0; i < LANES; ++i)
        predictor.extrapolates_stages[i] = 0;
    for (int k = 0; k < steps; ++k) {
        for (int e = 0; e < GROUPS; ++e)
            x[e] = splat(0);
        if (k > 0)
            predict(&predictor, history, GROUPS, ends, extrapolated, x);
        for (int e = 0; e < GROUPS; ++e) {
            predicted[k*GROUPS + e] = lane_get(&x[e], LANES - 1);
            x[e] = splat(values[k*GROUPS + e]);
        }
        record_values(&predictor, history, GROUPS, ends, rows, extrapolated, x);
    }
}

void toy_product_sum(int rows, int count, const real *factors, real sum[2])
{
    sum[0] = sum[1] = 0;
    for (int i = 0; i < rows; ++i)
        add_product(sum, count, factors + i*count);
}

void toy_crossings(long count, const real *values, real level, real last[2], long rows[2])
{
    flag_near_crossing(0, count, values, 1, level, last, rows);
}

/* Rows of LANES: x where a < b else y; the larger and the smaller; sqrt(x); x^y; y where a >= b else x. */
void toy_masks(const real *a, const real *b, const real *x, const real *y, real *out)
{
    lanes A = splat(0), B = splat(0), X = splat(0), Y = splat(0), result[6];
    for (int i = 0; i < LANES; ++i) {
        lane_set(&A, i, a[i]);
        lane_set(&B, i, b[i]);
        lane_set(&X, i, x[i]);
        lane_set(&Y, i, y[i]);
    }
    const lanes_mask below = A < B;
    result[0] = lanes_select_value(below, X, Y);
    result[1] = lanes_larger(A, B);
    result[2] = lanes_smaller(A, B);
    result[3] = lanes_square_root(X);
    result[4] = lanes_power(X, Y);
    result[5] = X;
    assign_lanes(lanes_mask_not(below), 1, &Y, &result[5]);
    for (int row = 0; row < 6; ++row)
        for (int i = 0; i < LANES; ++i)
            out[row*LANES + i] = lane_get(&result[row], i);
}

#if GS_SPARK
int toy_least_squares(int unknowns, int sides, int equations, const real *A, const real *b,
    real ridge, real *x);
int toy_least_squares_limits(int which);
void toy_table_product(int which, const real *base, const real *x, real *y);

/* x <- the minimum of |A x - b|^2 + ridge^2 |x|^2, for each column of b. */
int toy_least_squares(int unknowns, int sides, int equations, const real *A, const real *b,
    real ridge, real *x)
{
    static least_squares_t problem;
    if (unknowns > REGRESSORS || sides > 2*S)
        return 1;
    begin_least_squares(&problem, unknowns, sides, (const real[2]){ ridge, ridge });
    for (int e = 0; e < equations; ++e) {
        real *row = next_equation(&problem);
        for (int k = 0; k < unknowns; ++k)
            row[k] = A[e*unknowns + k];
        for (int j = 0; j < sides; ++j)
            row[right_side_start(&problem) + j] = b[e*sides + j];
    }
    solve_least_squares(&problem);
    for (int k = 0; k < unknowns; ++k)
        for (int j = 0; j < sides; ++j)
            x[k*sides + j] = coefficient_value(&problem, k, j);
    return 0;
}

int toy_least_squares_limits(int which)
{
    return which ? 2*S : REGRESSORS;
}

#if GS_CONSTRAINED
/* Products of the tables of a batch: Q, P, D and C from what stages and nodes have. */
void toy_table_product(int which, const real *base, const real *x, real *y)
{
    static BATCH(t) w;
    lanes from[P*N], to[P*N];
    for (int a = 0; a < N; ++a)
        w.q[a] = w.p[a] = splat(base[a]);
    for (int e = 0; e < P*N; ++e)
        from[e] = splat(x[e]);
    if (which == 0)
        BATCH(stage_positions)(&w, from, to);
    else if (which == 1)
        BATCH(add_momentum_rates)(&w, w.p, 0, from, to);
    else if (which == 2)
        BATCH(node_displacements)(&w, from, to);
    else
        BATCH(add_constraint_forces)(&w, from, to);
    for (int e = 0; e < P*N; ++e)
        y[e] = lane_get(&to[e], LANES - 1);
}
#endif
#endif

#if GS_FACTORS && !GS_ELEMENTS
void toy_small_lu(const real *W, real *b);

/* b <- W^-1 b, lane by lane: W in rows of LANES. */
void toy_small_lu(const real *W, real *b)
{
    schur_t factor;
    lanes x[M];
    for (int mu = 0; mu < M; ++mu) {
        x[mu] = splat(0);
        for (int i = 0; i < LANES; ++i)
            lane_set(&x[mu], i, b[mu*LANES + i]);
        for (int nu = 0; nu < M; ++nu) {
            factor[mu][nu] = splat(0);
            for (int i = 0; i < LANES; ++i)
                lane_set(&factor[mu][nu], i, W[(mu*M + nu)*LANES + i]);
        }
    }
    lanes_factor(factor);
    lanes_substitute_all(1, &factor, x);
    for (int mu = 0; mu < M; ++mu)
        for (int i = 0; i < LANES; ++i)
            b[mu*LANES + i] = lane_get(&x[mu], i);
}
#endif
#endif
