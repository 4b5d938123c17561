/* The least-squares predictor, and its selection. */

#include "gyrospark/tuning.h"

/* Number of distinct trajectories; the other lanes are padding. */
INLINE int SOLVER(trajectories)(const SOLVER(t) *w)
{
    return SOLVER(PER) == 1 ? w->constants._used : 1;
}

/* Number of steps that the history holds */
INLINE int SOLVER(history_length)(const SOLVER(t) *w)
{
    return w->predictor.count < HISTORY ? (int)w->predictor.count : HISTORY;
}

/*
 * History entry of step n - m, where n is the step to be predicted; m = 1 is the last completed
 * step.
 */
INLINE const lanes *SOLVER(history_values)(const SOLVER(t) *w, int m)
{
    return w->history + ((w->predictor.count + 1 - m) & (HISTORY - 1))*SOLVER(X);
}

/* Entry a of stage j of a trajectory, or of node j if `width` is M. */
INLINE real SOLVER(value_at)(const lanes *x, int trajectory, int j, int width, int a)
{
    return lane_get(&x[j/SOLVER(PER)*width + a], trajectory + j % SOLVER(PER));
}

/* Sets all lanes of a trajectory to one value. */
INLINE void SOLVER(set_trajectory)(lanes *x, int trajectory, real value)
{
    for (int i = 0; i < SOLVER(PER); ++i)
        lane_set(x, trajectory + i, value);
}

INLINE real SOLVER(sum_over_trajectory)(const lanes *x, int trajectory)
{
    real sum = lane_get(x, trajectory);
    for (int i = 1; i < SOLVER(PER); ++i)
        sum += lane_get(x, trajectory + i);
    return sum;
}

/* Tikhonov parameter: round-off level of the `count` entries at x, for one trajectory. */
static real SOLVER(ridge)(const lanes *x, int count, int trajectory)
{
    lanes square = splat(0);
    for (int e = 0; e < count; ++e)
        square += x[e]*x[e];
    return STAGE_RIDGE_UNITS*epsilon*MATH(sqrt)(SOLVER(sum_over_trajectory)(&square, trajectory))
        + MATH(sqrt)(LIMIT(MIN))*UNDERFLOW_MARGIN;
}

#if GS_CONSTRAINED
/* Largest order for which the history has two equations per coefficient. */
static int SOLVER(max_order)(long steps)
{
    int order = ORDER;
    while (order > 1 && (steps - order)*P*M < 2*order)
        --order;
    return order;
}

/* Fits one recurrence to the multipliers of a trajectory; each node gives an equation. */
static void SOLVER(fit_multipliers)(SOLVER(t) *w, least_squares_t *l, int trajectory)
{
    const int steps = SOLVER(history_length)(w), order = SOLVER(max_order)(steps);
    const int available = (steps - order)*P*M, stride = stride_of(available, order);
    const real ridge = SOLVER(ridge)(SOLVER(history_values)(w, 1) + SOLVER(IMPULSE),
        SOLVER(X) - SOLVER(IMPULSE), trajectory);
    begin_least_squares(l, order, 1, (const real[2]){ ridge, ridge });
    for (int e = 0; e < available; e += stride) {
        const int lag = 1 + e/(P*M), j = e/M % P, mu = e % M;
        real *row = next_equation(l);
        for (int k = 0; k < order; ++k)
            row[k] = SOLVER(value_at)(SOLVER(history_values)(w, lag + 1 + k) + SOLVER(IMPULSE),
                trajectory, j, M, mu);
        row[right_side_start(l)] = SOLVER(value_at)(SOLVER(history_values)(w, lag)
            + SOLVER(IMPULSE), trajectory, j, M, mu);
    }
    solve_least_squares(l);
    for (int k = 0; k < ORDER; ++k)
        SOLVER(set_trajectory)(&w->least_squares.multiplier_coefficients[k], trajectory,
            coefficient_value(l, k, 0));
    w->least_squares.order = order;
}

/* Evaluates the recurrence: the multipliers of the next step. */
INLINE void SOLVER(predict_multipliers)(const SOLVER(t) *w, lanes *x)
{
    const SOLVER(least_squares) *s = &w->least_squares;
    const lanes *past[ORDER];
    for (int m = 0; m < s->order; ++m)
        past[m] = SOLVER(history_values)(w, 1 + m) + SOLVER(IMPULSE);
    for (int e = 0; e < SOLVER(X) - SOLVER(IMPULSE); ++e) {
        lanes even = splat(0), odd = splat(0);
        for (int m = 0; m + 1 < s->order; m += 2) {
            even += s->multiplier_coefficients[m]*past[m][e];
            odd += s->multiplier_coefficients[m + 1]*past[m + 1][e];
        }
        if (s->order % 2 == 1)
            even += s->multiplier_coefficients[s->order - 1]*past[s->order - 1][e];
        x[e] = even + odd;
    }
}
#endif

#if GS_STAGES_IN_LANES
/* Index of the coefficient of regressor k, for an item of L (group 0) or L^ (group 1). */
INLINE int SOLVER(coefficient_index)(int k, int group, int item)
{
    return (2*k + group)*SOLVER(S) + item;
}

/* sum_ai += coefficient_i x_a, x_a the values of one stage */
INLINE void SOLVER(add_regressor)(const lanes *coefficients, const lanes *x, int stage, int count,
    lanes (*sum)[2*SOLVER(S)])
{
    lanes coefficient[2*SOLVER(S)];
    for (int i = 0; i < 2*SOLVER(S); ++i)
        coefficient[i] = lanes_in_register(coefficients[i]);
    for (int a = 0; a < count; ++a) {
        const lanes value = splat(lane_get(&x[a], stage));
        for (int i = 0; i < 2*SOLVER(S); ++i)
            sum[a][i] += coefficient[i]*value;
    }
}

/* Coordinates start..start + count - 1 of all stages of the next step. */
INLINE void SOLVER(predict_four)(const lanes *coefficients, const lanes *const *past, int lags,
    int start, int count, lanes *y)
{
    lanes sum[2][4][2*SOLVER(S)]; /* separate sums for the regressors L and L^ */
    for (int a = 0; a < count; ++a)
        for (int i = 0; i < 2*SOLVER(S); ++i)
            sum[0][a][i] = sum[1][a][i] = splat(0);
    for (int k = 0; k < LAST; ++k) {
        const int j = regressor_stage(k);
        for (int group = 0; group < 2; ++group, coefficients += 2*SOLVER(S))
            SOLVER(add_regressor)(coefficients, past[0] + group*SOLVER(HAT) + j/LANES*N + start,
                j % LANES, count, sum[group]);
    }
    for (int m = 1; m <= lags; ++m)
        for (int k = 0; k < stages_of_lag(m); ++k) {
            const int j = k*S/2;
            for (int group = 0; group < 2; ++group, coefficients += 2*SOLVER(S))
                SOLVER(add_regressor)(coefficients, past[m] + group*SOLVER(HAT) + j/LANES*N + start,
                    j % LANES, count, sum[group]);
        }
    for (int a = 0; a < count; ++a)
        for (int i = 0; i < 2*SOLVER(S); ++i)
            y[i*N + start + a] = sum[0][a][i] + sum[1][a][i];
}

INLINE void SOLVER(predict_stages)(const lanes *coefficients, const lanes *const *past, int lags,
    lanes *y)
{
    int start = 0;
    for (; start + 4 <= N; start += 4)
        SOLVER(predict_four)(coefficients, past, lags, start, 4, y);
    if (N % 4 > 0)
        SOLVER(predict_four)(coefficients, past, lags, start, N % 4, y);
}
#else
/* Coefficients are stored in blocks of four rows; rows are the stages of L, then of L^. */
enum { SOLVER(ROWS) = 2*SOLVER(S), SOLVER(BLOCK) = 4 };

/* Index of the coefficient of regressor k, for a stage of L (group 0) or L^ (group 1). */
INLINE int SOLVER(coefficient_index)(int k, int group, int item)
{
    const int row = group*SOLVER(S) + item, first = row - row % SOLVER(BLOCK);
    const int rows = SOLVER(ROWS) - first < SOLVER(BLOCK) ? SOLVER(ROWS) - first : SOLVER(BLOCK);
    return first*REGRESSORS + k*rows + row % SOLVER(BLOCK);
}

/* sum_ia += coefficient_i x_a */
INLINE void SOLVER(add_regressor)(const lanes *coefficients, int rows, const lanes *x, int count,
    lanes (*sum)[4])
{
    lanes value[4];
    for (int a = 0; a < count; ++a)
        value[a] = lanes_in_register(x[a]);
    for (int i = 0; i < rows; ++i) {
        const lanes coefficient = lanes_in_register(coefficients[i]);
        for (int a = 0; a < count; ++a)
            sum[i][a] += coefficient*value[a];
    }
}

/*
 * Coordinates start..start + count - 1 of the rows row..row + rows - 1 of the next step. The sums
 * stay in registers, and each coefficient is read once.
 */
INLINE void SOLVER(predict_block)(const lanes *coefficients, const lanes *const *past, int lags,
    int row, int rows, int start, int count, lanes *y)
{
    lanes sum[SOLVER(BLOCK)][4];
    LOAD_AGAIN(coefficients);
    for (int i = 0; i < rows; ++i)
        for (int a = 0; a < count; ++a)
            sum[i][a] = splat(0);
    for (int k = 0; k < 2*LAST; ++k, coefficients += rows) {
        const lanes *x = past[0] + k % 2*SOLVER(HAT) + regressor_stage(k/2)*N + start;
        SOLVER(add_regressor)(coefficients, rows, x, count, sum);
    }
    for (int m = 1; m <= lags; ++m)
        for (int k = 0; k < 2*stages_of_lag(m); ++k, coefficients += rows) {
            const lanes *x = past[m] + k % 2*SOLVER(HAT) + k/2*S/2*N + start;
            SOLVER(add_regressor)(coefficients, rows, x, count, sum);
        }
    for (int i = 0; i < rows; ++i)
        for (int a = 0; a < count; ++a)
            y[(row + i)*N + start + a] = sum[i][a];
}

INLINE void SOLVER(predict_rows)(const lanes *coefficients, const lanes *const *past, int lags,
    int row, int rows, lanes *y)
{
    int start = 0;
    coefficients += row*REGRESSORS;
    for (; start + 4 <= N; start += 4)
        SOLVER(predict_block)(coefficients, past, lags, row, rows, start, 4, y);
    if (N % 4 > 0)
        SOLVER(predict_block)(coefficients, past, lags, row, rows, start, N % 4, y);
}

INLINE void SOLVER(predict_stages)(const lanes *coefficients, const lanes *const *past, int lags,
    lanes *y)
{
    int row = 0;
    for (; row + SOLVER(BLOCK) <= SOLVER(ROWS); row += SOLVER(BLOCK))
        SOLVER(predict_rows)(coefficients, past, lags, row, SOLVER(BLOCK), y);
    if (SOLVER(ROWS) % SOLVER(BLOCK) > 0)
        SOLVER(predict_rows)(coefficients, past, lags, row, SOLVER(ROWS) % SOLVER(BLOCK), y);
}
#endif

/* Fits the coefficients of L and L^ of one trajectory; each coordinate gives an equation. */
static void SOLVER(fit_stages)(SOLVER(t) *w, least_squares_t *l, int trajectory, int lags)
{
    SOLVER(least_squares) *s = &w->least_squares;
    const int steps = SOLVER(history_length)(w), unknowns = 2*regressors_of(lags);
    const int available = (steps - 1 - lags)*MEASURED, stride = stride_of(available, unknowns);
    const lanes *newest = SOLVER(history_values)(w, 1);
    begin_least_squares(l, unknowns, 2*S, (const real[2]){
        SOLVER(ridge)(newest, SOLVER(HAT), trajectory),
        SOLVER(ridge)(newest + SOLVER(HAT), SOLVER(HAT), trajectory) });
    for (int e = 0; e < available; e += stride) {
        const int lag = 1 + e/MEASURED, a = e % MEASURED;
        real *row = next_equation(l), *right = row + right_side_start(l);
        for (int group = 0; group < 2; ++group) {
            const int at = group*SOLVER(HAT);
            const lanes *x = SOLVER(history_values)(w, lag) + at,
                *last = SOLVER(history_values)(w, lag + 1) + at;
            for (int j = 0; j < S; ++j)
                right[group*S + j] = SOLVER(value_at)(x, trajectory, j, N, a);
            for (int j = 0; j < LAST; ++j)
                row[2*j + group] = SOLVER(value_at)(last, trajectory, regressor_stage(j), N, a);
            for (int m = 1, column = 2*LAST + group; m <= lags; ++m)
                for (int k = 0; k < stages_of_lag(m); ++k, column += 2)
                    row[column] = SOLVER(value_at)(SOLVER(history_values)(w, lag + 1 + m) + at,
                        trajectory, k*S/2, N, a);
        }
    }
    solve_least_squares(l);
    for (int k = 0; k < REGRESSORS; ++k)
        for (int j = 0; j < 2*S; ++j)
            lane_set(&s->coefficients[SOLVER(coefficient_index)(k, j/S, j % S/SOLVER(PER))],
                trajectory + j % S % SOLVER(PER), coefficient_value(l, k, j));
}

/* Fits one trajectory. The fit is a candidate until the next step is complete. */
NOINLINE void SOLVER(fit)(SOLVER(t) *w, int trajectory)
{
    SOLVER(least_squares) *s = &w->least_squares;
    const int lags = max_lags(SOLVER(history_length)(w));
    least_squares_t problem;
    if (lags < 0)
        return;
    SOLVER(fit_stages)(w, &problem, trajectory, lags);
    IF_CONSTRAINED(SOLVER(fit_multipliers)(w, &problem, trajectory);)
    s->lags = lags;
    s->last_fit[trajectory] = w->predictor.count;
    s->pending[trajectory] = 1;
}

#if GS_CLOCK
/*
 * The stages of t and of its momentum by the collocation polynomial of the last step: t grows and
 * the momentum is constant, so that they do not have the frequencies of the other coordinates.
 */
INLINE void SOLVER(extrapolate_clock)(const SOLVER(t) *w, lanes *x)
{
    for (int at = N - 1; at < SOLVER(IMPULSE); at += SOLVER(HAT))
        SOLVER(product_of_columns)(SOLVER(S), S, N, 1, w->zero, 0, TABLE(onward),
            SOLVER(history_values)(w, 1) + at, x + at);
}
#endif

/* The least-squares prediction of the next step. */
NOINLINE void SOLVER(evaluate_least_squares)(const SOLVER(t) *w, lanes *x)
{
    const SOLVER(least_squares) *s = &w->least_squares;
    const lanes *past[LAGS + 1];
    for (int m = 0; m <= s->lags; ++m)
        past[m] = SOLVER(history_values)(w, 1 + m);
    SOLVER(predict_stages)(s->coefficients, past, s->lags, x);
    IF_CLOCK(SOLVER(extrapolate_clock)(w, x);)
    IF_CONSTRAINED(SOLVER(predict_multipliers)(w, x + SOLVER(IMPULSE));)
}

/* The next step by the collocation polynomial of the last one */
NOINLINE void SOLVER(extrapolate_stages)(SOLVER(t) *w)
{
    const lanes *x = SOLVER(history_values)(w, 1);
    SOLVER(stages_of_stages)(w->zero, 0, TABLE(onward), x, w->extrapolated);
    SOLVER(stages_of_stages)(w->zero, 0, TABLE(onward), x + SOLVER(HAT),
        w->extrapolated + SOLVER(HAT));
    IF_CONSTRAINED(SOLVER(nodes_of_nodes)(w->zero, 0, TABLE(onward_nodes), x + SOLVER(IMPULSE),
        w->extrapolated + SOLVER(IMPULSE));)
}

/* The baseline prediction: polynomials or a recurrence. */
INLINE void SOLVER(extrapolate)(SOLVER(t) *w)
{
    if (needs_stages(&w->predictor))
        SOLVER(extrapolate_stages)(w);
    predict(&w->predictor, w->history, SOLVER(X), SOLVER(group_ends), w->extrapolated,
        w->now.x);
}

/* 1 if all trajectories have selected least squares permanently: no recurrence is needed. */
INLINE int SOLVER(all_permanent)(const SOLVER(t) *w)
{
    int permanent = 1;
    for (int i = 0; i < SOLVER(trajectories)(w); ++i)
        permanent &= w->least_squares.permanent[i];
    return permanent;
}

/* Starting values from the history, with the predictor that each trajectory has selected. */
INLINE void SOLVER(predict_unknowns)(SOLVER(t) *w)
{
    SOLVER(least_squares) *s = &w->least_squares;
    const int trajectories = SOLVER(trajectories)(w);
    int selected = 0, pending = 0;
    for (int i = 0; i < trajectories; ++i) {
        selected += s->selected[i];
        pending += s->pending[i];
    }
    if (SOLVER(all_permanent)(w)
        || (pending == 0 && selected == trajectories && w->predictor.fitted)) {
        SOLVER(evaluate_least_squares)(w, w->now.x);
        for (int e = 0; e < SOLVER(IMPULSE) && pending > 0; ++e)
            s->candidate[e] = w->now.x[e];
        return;
    }
    SOLVER(extrapolate)(w);
    if (pending == 0 && selected == 0)
        return;
    SOLVER(evaluate_least_squares)(w, s->candidate);
    for (int e = 0; e < SOLVER(IMPULSE); ++e)
        s->baseline[e] = w->now.x[e];
    for (int i = 0; i < trajectories; ++i)
        for (int e = 0; e < SOLVER(X) && s->selected[i]; ++e)
            for (int j = i; j < i + SOLVER(PER); ++j)
                lane_set(&w->now.x[e], j, lane_get(&s->candidate[e], j));
}

/*
 * Compares pending candidates with the baseline at the completed step. A candidate is selected if
 * its squared error is smaller by the factor CANDIDATE_GAIN. If the second fit is selected, the
 * selection is permanent. No recurrence is fitted before that, so the selection does not depend on
 * other lanes.
 */
static void SOLVER(compare_candidates)(SOLVER(t) *w)
{
    SOLVER(least_squares) *s = &w->least_squares;
    const real accurate = ACCURATE_UNITS*epsilon;
    lanes candidate = splat(0), baseline = splat(0);
    for (int e = 0; e < SOLVER(IMPULSE); ++e) {
        const lanes size = e < SOLVER(HAT) ? w->q_weight : w->p_weight;
        const lanes by_candidate = s->candidate[e] - w->now.x[e],
            by_baseline = s->baseline[e] - w->now.x[e];
        if (e % N >= MEASURED)
            continue;
        candidate += size*by_candidate*by_candidate;
        baseline += size*by_baseline*by_baseline;
    }
    for (int i = 0; i < SOLVER(trajectories)(w); ++i) {
        if (!s->pending[i])
            continue;
        const real error = SOLVER(sum_over_trajectory)(&baseline, i);
        s->error[i] = SOLVER(sum_over_trajectory)(&candidate, i);
        if (!s->permanent[i])
            s->selected[i] = CANDIDATE_GAIN*s->error[i] < error && error > accurate*accurate;
        if (s->last_fit[i] == SECOND_FIT && w->predictor.count == SECOND_FIT)
            s->permanent[i] = s->selected[i];
        s->pending[i] = 0;
    }
}

/*
 * Appends the completed step to the history and fits the predictors. The recurrence is updated only
 * while a trajectory may need it. Least-squares fits are expensive and rare: the early ones are
 * omitted where the baseline is accurate, and later ones follow only where the prediction error has
 * grown.
 */
NOINLINE void SOLVER(record_step)(SOLVER(t) *w)
{
    const real low = ERROR_FLOOR_UNITS*epsilon, poor = POOR_UNITS*epsilon;
    SOLVER(least_squares) *s = &w->least_squares;
    predictor_t *predictor = &w->predictor;
    const int fitted = predictor->fitted, trajectories = SOLVER(trajectories)(w);
    int pending = 0;
    for (int i = 0; i < trajectories; ++i)
        pending += s->pending[i];
    if (pending > 0)
        SOLVER(compare_candidates)(w);
    if (SOLVER(all_permanent)(w))
        store_values(predictor, w->history, SOLVER(X), w->now.x);
    else {
        /* the prediction may have been another one, by least squares of all trajectories */
        if (fitted && (selects_again(predictor) || completes_fit(predictor)))
            SOLVER(extrapolate_stages)(w);
        record_values(predictor, w->history, SOLVER(X), SOLVER(group_ends), SOLVER(group_rows),
            w->extrapolated, w->now.x);
    }
    const long count = predictor->count;
    const int early = count == FIRST_FIT || count == SECOND_FIT;
    for (int i = 0; i < trajectories; ++i) {
        const int worse = s->selected[i] && count >= s->last_fit[i] + HISTORY
            && !(predictor->first[i] < DEGRADATION*larger(s->error[i], low*low));
        const int inaccurate = s->last_fit[i] > 0 || !(predictor->first[i] < poor*poor);
        if ((early && inaccurate) || count == LATE_FIT*HISTORY || worse)
            SOLVER(fit)(w, i);
        else if (s->last_fit[i] > 0 && fitted != predictor->fitted)
            s->pending[i] = 1;
    }
}

/* Clears the history, the fits and the selection. */
static void SOLVER(reset_history)(SOLVER(t) *w)
{
    SOLVER(least_squares) *s = &w->least_squares;
    reset_predictor(&w->predictor);
    s->lags = s->order = 0;
    w->predictor.fit_start = SECOND_FIT + 3; /* after the permanent selection */
    for (int i = 0; i < SOLVER(TRAJECTORIES); ++i) {
        s->selected[i] = s->permanent[i] = s->pending[i] = 0;
        s->last_fit[i] = 0;
        s->error[i] = 0;
    }
    for (int k = 0; k < REGRESSORS*2*SOLVER(S); ++k)
        s->coefficients[k] = splat(0);
    for (int k = 0; k < ORDER; ++k)
        s->multiplier_coefficients[k] = splat(0);
}
