/* Starting values by extrapolation and by linear recurrences. */
#ifndef GS_PREDICTOR_RECURRENCE_H
#define GS_PREDICTOR_RECURRENCE_H

#include "gyrospark/linear_algebra/norms.h"
#include "gyrospark/simd/vector.h"

/* ---------------------------------------------------------------- starting values from the past */

/*
 * Each unknown is predicted from its own values in the last steps, x_n = sum_m c_m x_(n-m). Stages
 * of a spinning body are sums of a few exponentials, and one set of c_m serves them all: such a
 * sum obeys a linear recurrence. At first the c_m are those of polynomial extrapolation, of the
 * order that would have done best at the last step, unless the polynomial through the stages of
 * the last step would have done better; then they are fitted by least squares to the steps just
 * done (Givens rotations; the ridge is the round-off of the past values, which keeps the c_m
 * small). They change the starting values only, never what the sweeps converge to.
 */
enum { ORDER = 16, POLYNOMIAL = 8, SAMPLES = 24, STRIDE = 2, RATES = 24 };
enum { EQUATIONS = 16 }; /* that a group gives to a fit at one step */
enum { RESELECT = 8, RESELECT_ORDER = 12 }; /* steps between looks at a fit, polynomials in its place */
/* Rates of q, of p, and multipliers have each their own recurrence. */
enum { GROUPS = 3 };

typedef struct {
    long count;    /* steps recorded */
    long fit_start; /* the step from which the next fit takes its samples */
    int order;     /* c_m in use */
    int fitted;    /* whether by least squares */
    lanes rate[RATES]; /* by how much sweeps shrink changes, sweep by sweep: squares, means */
    real first[LANES]; /* what the first sweep changed of the last prediction, squared */
    int extrapolates_stages[LANES]; /* lanes that are better off with the polynomial through the last stages */
    lanes coefficient[GROUPS][ORDER];
    lanes R[GROUPS][ORDER + 1][ORDER + 1]; /* triangular factor of the fit, right side last */
} predictor_t;

/* Which rate is that of a sweep; behind it is that of the next. */
INLINE int rate_index(int sweep)
{
    return sweep < RATES - 1 ? sweep - 1 : RATES - 2;
}

/* Whether this step is one that watches them: the first ones do, and some of the others. */
INLINE int updates_rates(const predictor_t *s)
{
    return s->count < 64 || s->count % 8 == 0;
}

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

/* The values of m steps ago; m = 0 is the place of the newest. */
INLINE lanes *history_entry(const predictor_t *s, lanes *history, int length, int m)
{
    return history + ((s->count - m) & (HISTORY - 1))*length;
}

/* x = sum_m c_m x_(n-m), m = 1..order, group by group */
INLINE void evaluate_recurrence(const predictor_t *s, int order, lanes *history, int length, const int *ends,
    lanes *x)
{
    const lanes *before[ORDER];
    for (int m = 0; m < order; ++m)
        before[m] = history_entry(s, history, length, m);
    for (int group = 0, i = 0; group < GROUPS; ++group) {
        const lanes *c = s->coefficient[group];
        for (; i + 2 <= ends[group]; i += 2) {
            lanes first = c[0]*before[0][i], second = c[0]*before[0][i + 1];
            for (int m = 1; m < order; ++m) {
                first += c[m]*before[m][i];
                second += c[m]*before[m][i + 1];
            }
            x[i] = first;
            x[i + 1] = second;
        }
        for (; i < ends[group]; ++i) {
            x[i] = c[0]*before[0][i];
            for (int m = 1; m < order; ++m)
                x[i] += c[m]*before[m][i];
        }
    }
}

/* Starting values x; `through` are those of the polynomial through the last stages. */
INLINE void predict(const predictor_t *s, lanes *history, int length, const int *ends,
    const lanes *extrapolated, lanes *x)
{
    if (s->fitted) {
        evaluate_recurrence(s, ORDER, history, length, ends, x);
        return;
    }
    evaluate_recurrence(s, s->order, history, length, ends, x);
    for (int i = 0; i < LANES; ++i)
        for (int e = 0; e < length && s->extrapolates_stages[i]; ++e)
            lane_set(&x[e], i, lane_get(&extrapolated[e], i));
}

/*
 * What polynomials through the last k values, k = 1 to `most`, would have missed x by, squared: the
 * differences of x with its past.
 */
INLINE void extrapolation_errors(const predictor_t *s, lanes *history, int length, int rows, int most,
    const lanes *x, lanes *error)
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

INLINE int best_order(const lanes *error, int most, int lane)
{
    int best = 1;
    for (int k = 2; k <= most; ++k)
        if (lane_get(&error[k], lane) < lane_get(&error[best], lane))
            best = k;
    return best;
}

/* The polynomial through the last k values as a recurrence of a lane. */
INLINE void set_polynomial(predictor_t *s, int lane, int k)
{
    real binomial = (real)k;
    for (int m = 0; m < s->order; ++m) {
        for (int group = 0; group < GROUPS; ++group)
            lane_set(&s->coefficient[group][m], lane, binomial);
        binomial *= -(real)(k - m - 1)/(real)(m + 2);
    }
}

/* Chooses, lane by lane, the extrapolation that comes closest to x. */
INLINE void select_polynomial(predictor_t *s, lanes *history, int length, int rows,
    const lanes *extrapolated, const lanes *x)
{
    lanes error[POLYNOMIAL + 1];
    s->order = s->count < POLYNOMIAL ? (int)s->count : POLYNOMIAL;
    error[0] = splat(0);
    for (int i = 0; i < rows; ++i)
        error[0] += (extrapolated[i] - x[i])*(extrapolated[i] - x[i]);
    extrapolation_errors(s, history, length, rows, s->order, x, error);
    for (int i = 0; i < LANES; ++i) {
        const int best = best_order(error, s->order, i);
        s->extrapolates_stages[i] = lane_get(&error[0], i) < lane_get(&error[best], i);
        set_polynomial(s, i, best);
    }
}

/*
 * A motion that does not stay what it was outlives its fit. Where predictions are far from x, and a
 * polynomial would have been clearly closer, it takes the place of the recurrence, or of another
 * one, until the next fit.
 */
NOINLINE void reselect_polynomial(predictor_t *s, lanes *history, int length, const int *rows,
    const lanes *x)
{
    const real far = 16777216*epsilon;
    lanes error[RESELECT_ORDER + 1], found = splat(0);
    int rough = 0;
    for (int i = 0; i < LANES; ++i)
        rough |= s->first[i] > far*far;
    if (!rough)
        return;
    for (int i = 0; i < rows[0]; ++i) {
        lanes defect = x[i];
        for (int m = 0; m < ORDER; ++m)
            defect -= s->coefficient[0][m]*history_entry(s, history, length, m)[i];
        found += defect*defect;
    }
    extrapolation_errors(s, history, length, rows[0], RESELECT_ORDER, x, error);
    for (int i = 0; i < LANES; ++i) {
        const int best = best_order(error, RESELECT_ORDER, i);
        if (s->first[i] > far*far && 4*lane_get(&error[best], i) < lane_get(&found, i))
            set_polynomial(s, i, best);
    }
}

/* Empty least-squares problems: R = the ridge. */
INLINE void begin_fit(predictor_t *s, const int *ends, const lanes *x)
{
    const real tiny = MATH(sqrt)(LIMIT(MIN))*1024;
    for (int group = 0, start = 0; group < GROUPS; start = ends[group++])
        for (int k = 0; k <= ORDER; ++k)
            for (int l = 0; l <= ORDER; ++l)
                for (int i = 0; i < LANES; ++i) {
                    real size = tiny;
                    for (int e = start; k == l && e < ends[group]; ++e)
                        size = larger(size, 8*epsilon*MATH(fabs)(lane_get(&x[e], i)));
                    lane_set(&s->R[group][k][l], i, k == l && k < ORDER ? size : 0);
                }
}

/* One more equation, sum_m c_m x_(n-m) = x_n, for the value at place e. */
INLINE void add_equation(predictor_t *s, lanes *history, int length, int group, int e, const lanes *x)
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

/* The c_m of the fit: the shortest recurrence that fits within a factor of the longest. */
static void solve_fit(predictor_t *s)
{
    s->order = ORDER;
    s->fitted = 1;
    for (int group = 0; group < GROUPS; ++group) {
        lanes (*R)[ORDER + 1] = s->R[group];
        for (int i = 0; i < LANES; ++i) {
            real defect = lane_get(&R[ORDER][ORDER], i), c[ORDER];
            const real allowed = 16*defect;
            int order = ORDER;
            while (order > 1) {
                const real more = lane_get(&R[order - 1][ORDER], i);
                if (!(defect + more*more <= allowed))
                    break;
                defect += more*more;
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

/* The values x of the step just done become the past. */
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
 * Records them, for a recurrence too. Equations for a fit come from the first `rows` of each group:
 * its other values obey the same recurrence.
 */
INLINE void record_values(predictor_t *s, lanes *history, int length, const int *ends, const int *rows,
    const lanes *extrapolated, const lanes *x)
{
    const long frame_start = s->count - s->fit_start;
    if (s->count > 0 && !s->fitted && frame_start <= 0)
        select_polynomial(s, history, length, rows[0], extrapolated, x);
    if (s->fitted && s->count % RESELECT == 0)
        reselect_polynomial(s, history, length, rows, x);
    if (frame_start == 0)
        begin_fit(s, ends, x);
    if (frame_start >= 0 && frame_start % STRIDE == 0)
        for (int group = 0, start = 0; group < GROUPS; start = ends[group++])
            for (int apart = 1 + (rows[group] - 1)/EQUATIONS,
                     e = start + (int)(frame_start/STRIDE) % apart; e < start + rows[group]; e += apart)
                add_equation(s, history, length, group, e, x);
    if (frame_start == STRIDE*(SAMPLES - 1)) {
        solve_fit(s);
        s->fit_start = s->count + (s->count < 4096 ? 16*s->count : 65536);
    }
    store_values(s, history, length, x);
}

#endif
