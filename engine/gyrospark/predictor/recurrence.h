/* Starting values by extrapolation and by linear recurrences. */
#ifndef GS_PREDICTOR_RECURRENCE_H
#define GS_PREDICTOR_RECURRENCE_H

#include "gyrospark/linear_algebra/norms.h"
#include "gyrospark/simd/vector.h"
#include "gyrospark/tuning.h"

/* ------------------------------------------------------- linear prediction of starting values */

/*
 * x_n = sum_m c_m x_(n-m): each unknown is predicted from its own values in the last steps. Stages
 * of a spinning body are sums of a few exponentials; such a sum obeys a linear recurrence, and all
 * unknowns of a group have the same c_m. Before the first fit, the c_m are the coefficients of
 * polynomial extrapolation with the order that was most accurate at the last step, unless the
 * collocation polynomial of the last step was more accurate. Afterwards the c_m are fitted to the
 * history by least squares (Givens rotations), and polynomials take their place where they are
 * clearly more accurate. The Tikhonov parameter (ridge) is the round-off level of the history, which
 * keeps the c_m small. The predictor changes the starting values only, never the limit of the
 * iteration.
 */
enum { ORDER = 16, POLYNOMIAL = 8, SAMPLES = 24, STRIDE = 2, RATES = 24 };
enum { EQUATIONS = 16 }; /* at most, per group and step of a fit */
enum { RESELECT = 8, RESELECT_ORDER = 12 }; /* interval of the test; highest polynomial order */
/*
 * Starting values of an iteration: explicit Euler, prediction, or continuation in the step size,
 * with iterations of steps h/4 and h/2. An explicit Euler start of a long step may diverge where
 * the iteration converges from a better start.
 */
enum { EULER, PREDICTED, QUARTER_STEP, FROM_HALF_STEP };
/* One recurrence each for the rates of q, the rates of p, and the multipliers. */
enum { GROUPS = 3 };

typedef struct {
    long count;    /* steps recorded */
    long fit_start; /* first step of the samples of the next fit */
    int order;     /* number of c_m in use */
    int fitted;    /* 1 after the first least-squares fit */
    lanes rate[RATES]; /* squared contraction rate of each iteration, running means */
    real first[LANES]; /* squared change of the first iteration: the error of the prediction */
    int extrapolates_stages[LANES]; /* 1 where the collocation polynomial is most accurate */
    lanes coefficient[GROUPS][ORDER];
    lanes R[GROUPS][ORDER + 1][ORDER + 1]; /* triangular factor of the fit, right-hand side last */
} predictor_t;

/* Index into rate[] of an iteration; the next entry is the rate of the next iteration. */
INLINE int rate_index(int iteration)
{
    return iteration < RATES - 1 ? iteration - 1 : RATES - 2;
}

/* 1 if this step updates the contraction rates. */
INLINE int updates_rates(const predictor_t *s)
{
    return s->count < INITIAL_RATE_STEPS || s->count % RATE_STRIDE == 0;
}

/* Forgets history, fits and contraction rates. */
static void reset_predictor(predictor_t *s)
{
    s->count = 0;
    s->fit_start = ORDER + 1;
    s->order = s->fitted = 0;
    for (int i = 0; i < LANES; ++i)
        s->extrapolates_stages[i] = 1;
    for (int i = 0; i < LANES; ++i)
        s->first[i] = 1;
    for (int i = 0; i < RATES; ++i)
        s->rate[i] = splat(1);
}

/*
 * The entry m steps before the newest one (m = 0). In store_values, count is already incremented,
 * so m = 0 is the entry to be written.
 */
INLINE lanes *history_entry(const predictor_t *s, lanes *history, int length, int m)
{
    return history + ((s->count - m) & (HISTORY - 1))*length;
}

/* x = sum_m c_m x_(n-m), m = 1..order, group by group */
INLINE void evaluate_recurrence(const predictor_t *s, int order, lanes *history, int length,
    const int *ends, lanes *x)
{
    const lanes *past[ORDER];
    for (int m = 0; m < order; ++m)
        past[m] = history_entry(s, history, length, m);
    for (int group = 0, i = 0; group < GROUPS; ++group) {
        const lanes *c = s->coefficient[group];
        for (; i + 2 <= ends[group]; i += 2) {
            lanes first = c[0]*past[0][i], second = c[0]*past[0][i + 1];
            for (int m = 1; m < order; ++m) {
                first += c[m]*past[m][i];
                second += c[m]*past[m][i + 1];
            }
            x[i] = first;
            x[i + 1] = second;
        }
        for (; i < ends[group]; ++i) {
            x[i] = c[0]*past[0][i];
            for (int m = 1; m < order; ++m)
                x[i] += c[m]*past[m][i];
        }
    }
}

/* 1 if the prediction needs the collocation polynomial of the last step. */
INLINE int needs_stages(const predictor_t *s)
{
    int needed = !s->fitted;
    for (int i = 0; i < LANES; ++i)
        needed |= s->extrapolates_stages[i];
    return needed;
}

/* 1 if polynomials are compared with the recurrence at this step: the prediction is poor. */
INLINE int selects_again(const predictor_t *s)
{
    const real poor = POOR_UNITS*epsilon;
    int any_poor = 0;
    for (int i = 0; i < LANES; ++i)
        any_poor |= s->first[i] > poor*poor;
    return s->fitted && s->count % RESELECT == 0 && any_poor;
}

/* 1 if this step completes the equations of a fit. */
INLINE int completes_fit(const predictor_t *s)
{
    return s->count - s->fit_start == STRIDE*(SAMPLES - 1);
}

/* Starting values x; `extrapolated` are the values of the last collocation polynomial. */
INLINE void predict(const predictor_t *s, lanes *history, int length, const int *ends,
    const lanes *extrapolated, lanes *x)
{
    if (s->fitted)
        evaluate_recurrence(s, ORDER, history, length, ends, x);
    else
        evaluate_recurrence(s, s->order, history, length, ends, x);
    for (int i = 0; i < LANES; ++i)
        for (int e = 0; e < length && s->extrapolates_stages[i]; ++e)
            lane_set(&x[e], i, lane_get(&extrapolated[e], i));
}

INLINE lanes squared_distance(const lanes *x, const lanes *y, int rows)
{
    lanes sum = splat(0);
    for (int i = 0; i < rows; ++i)
        sum += (x[i] - y[i])*(x[i] - y[i]);
    return sum;
}

/* Squared error at x of the recurrence of the first group, in its first `rows` entries */
INLINE lanes error_of_recurrence(const predictor_t *s, lanes *history, int length, int rows,
    const lanes *x)
{
    lanes sum = splat(0);
    for (int i = 0; i < rows; ++i) {
        lanes defect = x[i];
        for (int m = 0; m < ORDER; ++m)
            defect -= s->coefficient[0][m]*history_entry(s, history, length, m)[i];
        sum += defect*defect;
    }
    return sum;
}

/*
 * Squared errors at x of the polynomials through the last k values, k = 1..most: the error of order
 * k is the k-th backward difference.
 */
INLINE void extrapolation_errors(const predictor_t *s, lanes *history, int length, int rows,
    int most, const lanes *x, lanes *error)
{
    const lanes *value[RESELECT_ORDER + 1];
    value[0] = x;
    for (int k = 1; k <= most; ++k) {
        value[k] = history_entry(s, history, length, k - 1);
        error[k] = splat(0);
    }
    for (int i = 0; i < rows; ++i) {
        lanes difference[RESELECT_ORDER + 1];
        for (int k = 0; k <= most; ++k)
            difference[k] = value[k][i];
        for (int k = 1; k <= most; ++k) {
            for (int m = 0; m <= most - k; ++m)
                difference[m] -= difference[m + 1];
            error[k] += difference[0]*difference[0];
        }
    }
}

/* The order 1..most with the smallest error in a lane */
INLINE int best_order(const lanes *error, int most, int lane)
{
    int best = 1;
    for (int k = 2; k <= most; ++k)
        if (lane_get(&error[k], lane) < lane_get(&error[best], lane))
            best = k;
    return best;
}

/* c_m = (-1)^(m+1) binomial(k, m): the polynomial through the last k values, as a recurrence. */
INLINE void set_polynomial(predictor_t *s, int lane, int k)
{
    real binomial = (real)k;
    for (int m = 0; m < s->order; ++m) {
        for (int group = 0; group < GROUPS; ++group)
            lane_set(&s->coefficient[group][m], lane, binomial);
        binomial *= -(real)(k - m - 1)/(real)(m + 2);
    }
}

/* Selects, lane by lane, the extrapolation with the smallest error at x. */
INLINE void select_polynomial(predictor_t *s, lanes *history, int length, int rows,
    const lanes *extrapolated, const lanes *x)
{
    lanes error[POLYNOMIAL + 1];
    s->order = s->count < POLYNOMIAL ? (int)s->count : POLYNOMIAL;
    error[0] = squared_distance(extrapolated, x, rows);
    extrapolation_errors(s, history, length, rows, s->order, x, error);
    for (int i = 0; i < LANES; ++i) {
        const int best = best_order(error, s->order, i);
        s->extrapolates_stages[i] = lane_get(&error[0], i) < lane_get(&error[best], i);
        set_polynomial(s, i, best);
    }
}

/*
 * A fit loses its accuracy when the frequencies of the motion drift, and a motion of many
 * frequencies has no recurrence. If the prediction is poor and a polynomial through the last values
 * is clearly more accurate, it replaces the recurrence until the next fit; the collocation
 * polynomial of the last step is in use as long as it is more accurate than what it replaces.
 */
NOINLINE void reselect_polynomial(predictor_t *s, lanes *history, int length, const int *rows,
    const lanes *extrapolated, const lanes *x)
{
    const real poor = POOR_UNITS*epsilon;
    lanes error[RESELECT_ORDER + 1];
    const lanes recurrence_error = error_of_recurrence(s, history, length, rows[0], x);
    error[0] = squared_distance(extrapolated, x, rows[0]);
    extrapolation_errors(s, history, length, rows[0], RESELECT_ORDER, x, error);
    for (int i = 0; i < LANES; ++i) {
        const int best = best_order(error, RESELECT_ORDER, i);
        real smallest = lane_get(&recurrence_error, i);
        if (!(s->first[i] > poor*poor))
            continue;
        if (POLYNOMIAL_GAIN*lane_get(&error[best], i) < smallest) {
            set_polynomial(s, i, best);
            smallest = lane_get(&error[best], i);
        }
        const real gain = s->extrapolates_stages[i] ? 1 : POLYNOMIAL_GAIN;
        s->extrapolates_stages[i] = gain*lane_get(&error[0], i) < smallest;
    }
}

/* R = ridge*I: empties the least-squares problem of each group. */
INLINE void begin_fit(predictor_t *s, const int *ends, const lanes *x)
{
    const real tiny = MATH(sqrt)(LIMIT(MIN))*UNDERFLOW_MARGIN;
    for (int group = 0, start = 0; group < GROUPS; start = ends[group++])
        for (int k = 0; k <= ORDER; ++k)
            for (int l = 0; l <= ORDER; ++l)
                for (int i = 0; i < LANES; ++i) {
                    real size = tiny;
                    for (int e = start; k == l && e < ends[group]; ++e)
                        size = larger(size,
                            RIDGE_UNITS*epsilon*MATH(fabs)(lane_get(&x[e], i)));
                    lane_set(&s->R[group][k][l], i, k == l && k < ORDER ? size : 0);
                }
}

/* Adds the equation sum_m c_m x_(n-m) = x_n of entry e, by Givens rotations. */
INLINE void add_equation(predictor_t *s, lanes *history, int length, int group, int e,
    const lanes *x)
{
    lanes row[ORDER + 1], (*R)[ORDER + 1] = s->R[group];
    for (int m = 0; m < ORDER; ++m)
        row[m] = history_entry(s, history, length, m)[e];
    row[ORDER] = x[e];
    for (int k = 0; k < ORDER; ++k) {
        const lanes square = R[k][k]*R[k][k] + row[k]*row[k];
        lanes inverse = square;
        for (int i = 0; i < LANES; ++i)
            lane_set(&inverse, i, 1/MATH(sqrt)(lane_get(&square, i)));
        const lanes cosine = R[k][k]*inverse, sine = row[k]*inverse;
        for (int l = k; l <= ORDER; ++l) {
            const lanes upper = R[k][l];
            R[k][l] = cosine*upper + sine*row[l];
            row[l] = cosine*row[l] - sine*upper;
        }
    }
    R[ORDER][ORDER] += row[ORDER]*row[ORDER];
}

/*
 * The c_m of the fit. The order is the smallest one whose squared defect is at most
 * DEFECT_ALLOWANCE times the defect of the full order: more coefficients would fit round-off.
 */
static void solve_fit(predictor_t *s)
{
    s->order = ORDER;
    s->fitted = 1;
    for (int group = 0; group < GROUPS; ++group) {
        lanes (*R)[ORDER + 1] = s->R[group];
        for (int i = 0; i < LANES; ++i) {
            real defect = lane_get(&R[ORDER][ORDER], i), c[ORDER];
            const real allowed = DEFECT_ALLOWANCE*defect;
            int order = ORDER;
            while (order > 1) {
                const real removed = lane_get(&R[order - 1][ORDER], i);
                if (!(defect + removed*removed <= allowed))
                    break;
                defect += removed*removed;
                --order;
            }
            for (int k = ORDER - 1; k >= 0; --k) {
                c[k] = k < order ? lane_get(&R[k][ORDER], i) : 0;
                for (int l = k + 1; l < order; ++l)
                    c[k] -= lane_get(&R[k][l], i)*c[l];
                c[k] = k < order ? c[k]/lane_get(&R[k][k], i) : 0;
                lane_set(&s->coefficient[group][k], i, c[k]);
            }
        }
    }
}

/* Appends the values x of the completed step to the history. */
INLINE void store_values(predictor_t *s, lanes *history, int length, const lanes *x)
{
    ++s->count;
    lanes *newest = history_entry(s, history, length, 0);
    for (int i = 0; i < length; ++i)
        newest[i] = x[i];
    if (s->count == 1) {
        s->order = 1;
        for (int group = 0; group < GROUPS; ++group)
            s->coefficient[group][0] = splat(1);
    }
}

/*
 * Appends x to the history and updates the recurrence. A fit takes its equations from the first
 * `rows` entries of each group, as all entries of a group obey the same recurrence.
 */
INLINE void record_values(predictor_t *s, lanes *history, int length, const int *ends,
    const int *rows, const lanes *extrapolated, const lanes *x)
{
    const long elapsed = s->count - s->fit_start;
    if (s->count > 0 && !s->fitted && elapsed <= 0)
        select_polynomial(s, history, length, rows[0], extrapolated, x);
    if (selects_again(s))
        reselect_polynomial(s, history, length, rows, extrapolated, x);
    if (elapsed == 0)
        begin_fit(s, ends, x);
    if (elapsed >= 0 && elapsed % STRIDE == 0)
        for (int group = 0, start = 0; group < GROUPS; start = ends[group++])
            for (int spacing = 1 + (rows[group] - 1)/EQUATIONS,
                     e = start + (int)(elapsed/STRIDE) % spacing;
                 e < start + rows[group]; e += spacing)
                add_equation(s, history, length, group, e, x);
    if (completes_fit(s)) {
        solve_fit(s);
        const lanes by_recurrence = error_of_recurrence(s, history, length, rows[0], x),
            by_stages = squared_distance(extrapolated, x, rows[0]);
        for (int i = 0; i < LANES; ++i)
            s->extrapolates_stages[i] &= lane_get(&by_stages, i) < lane_get(&by_recurrence, i);
        s->fit_start = s->count + (s->count < REFIT_GROWTH_END ? REFIT_FACTOR*s->count
            : REFIT_INTERVAL);
    }
    store_values(s, history, length, x);
}

#endif
