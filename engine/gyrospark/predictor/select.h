/* The least-squares predictor, and its selection. */

/* How many trajectories differ. */
INLINE int SOLVER(tracks)(const SOLVER(t) *w)
{
    return SOLVER(PER) == 1 ? w->constants._used : 1;
}

INLINE int SOLVER(steps_recalled)(const SOLVER(t) *w)
{
    return w->predictor.count < HISTORY ? (int)w->predictor.count : HISTORY;
}

/* The values of m steps ago, m = 0 for the next. */
INLINE const lanes *SOLVER(recalled)(const SOLVER(t) *w, int m)
{
    return w->past + ((w->predictor.count + 1 - m) & (HISTORY - 1))*SOLVER(X);
}

/* Number a of stage j of a trajectory; of a node where `width` is M. */
INLINE real SOLVER(number)(const lanes *x, int track, int j, int width, int a)
{
    return part(&x[j/SOLVER(PER)*width + a], track + j % SOLVER(PER));
}

/* The same number in all lanes of a trajectory. */
INLINE void SOLVER(set_track)(lanes *x, int track, real value)
{
    for (int i = 0; i < SOLVER(PER); ++i)
        set_part(x, track + i, value);
}

INLINE real SOLVER(of_track)(const lanes *x, int track)
{
    real sum = part(x, track);
    for (int i = 1; i < SOLVER(PER); ++i)
        sum += part(x, track + i);
    return sum;
}

/* The ridge: round-off of the `count` items at x, of one trajectory. */
static real SOLVER(ridge)(const lanes *x, int count, int track)
{
    lanes square = splat(0);
    for (int e = 0; e < count; ++e)
        square += x[e]*x[e];
    return 4*epsilon*MATH(sqrt)(SOLVER(of_track)(&square, track)) + MATH(sqrt)(LIMIT(MIN))*1024;
}

#if GS_CONSTRAINED
/* The order of a recurrence of all multipliers that there are equations for. */
static int SOLVER(order_after)(long steps)
{
    int order = ORDER;
    while (order > 1 && (steps - order)*P*M < 2*order)
        --order;
    return order;
}

/* The recurrence of the multipliers of one trajectory, from equations of all nodes. */
static void SOLVER(learn_nodes)(SOLVER(t) *w, lesson_t *l, int track)
{
    const int steps = SOLVER(steps_recalled)(w), order = SOLVER(order_after)(steps);
    const int available = (steps - order)*P*M, stride = stride_of(available, order);
    const real ridge = SOLVER(ridge)(SOLVER(recalled)(w, 1) + SOLVER(IMPULSE), SOLVER(X) - SOLVER(IMPULSE), track);
    begin_lesson(l, order, 1, (const real[2]){ ridge, ridge });
    for (int e = 0; e < available; e += stride) {
        const int ago = 1 + e/(P*M), j = e/M % P, mu = e % M;
        real *row = next_row(l);
        for (int k = 0; k < order; ++k)
            row[k] = SOLVER(number)(SOLVER(recalled)(w, ago + 1 + k) + SOLVER(IMPULSE), track, j, M, mu);
        row[right_sides(l)] = SOLVER(number)(SOLVER(recalled)(w, ago) + SOLVER(IMPULSE), track, j, M, mu);
    }
    end_lesson(l);
    for (int k = 0; k < ORDER; ++k)
        SOLVER(set_track)(&w->lessons.wave[k], track, learnt(l, k, 0));
    w->lessons.order = order;
}

/* The multipliers of the next step by it. */
INLINE void SOLVER(nodes_ahead)(const SOLVER(t) *w, lanes *x)
{
    const SOLVER(lessons) *s = &w->lessons;
    const lanes *before[ORDER];
    for (int m = 0; m < s->order; ++m)
        before[m] = SOLVER(recalled)(w, 1 + m) + SOLVER(IMPULSE);
    for (int e = 0; e < SOLVER(X) - SOLVER(IMPULSE); ++e) {
        lanes even = splat(0), odd = splat(0);
        for (int m = 0; m + 1 < s->order; m += 2) {
            even += s->wave[m]*before[m][e];
            odd += s->wave[m + 1]*before[m + 1][e];
        }
        if (s->order % 2 == 1)
            even += s->wave[s->order - 1]*before[s->order - 1][e];
        x[e] = even + odd;
    }
}
#else
/* Without constraints there are no multipliers to learn of. */
static void SOLVER(learn_nodes)(const SOLVER(t) *w, const lesson_t *l, int track)
{
    (void)w, (void)l, (void)track;
}

INLINE void SOLVER(nodes_ahead)(const SOLVER(t) *w, const lanes *x)
{
    (void)w, (void)x;
}
#endif

#if GS_STAGES_IN_LANES
/* Where the coefficient of regressor k for an item of L (group 0) or L^ (1) stands. */
INLINE int SOLVER(coefficient)(int k, int group, int item)
{
    return (2*k + group)*SOLVER(S) + item;
}

/* Numbers start..start + count - 1 of the stages of the next step, `count` of each. */
INLINE void SOLVER(four_ahead)(const lanes *next, const lanes *const *before, int lags, int start,
    int count, lanes *y)
{
    lanes sum[2][4][2*SOLVER(S)]; /* of L and of L^ as regressors */
    for (int a = 0; a < count; ++a)
        for (int i = 0; i < 2*SOLVER(S); ++i)
            sum[0][a][i] = sum[1][a][i] = splat(0);
    for (int k = 0; k < 2*LAST; ++k, next += 2*SOLVER(S))
        for (int a = 0; a < count; ++a) {
            const int j = stage_regarded(k/2), item = k % 2*SOLVER(HAT) + j/LANES*N;
            const lanes value = splat(part(&before[0][item + start + a], j % LANES));
            for (int i = 0; i < 2*SOLVER(S); ++i)
                sum[k % 2][a][i] += next[i]*value;
        }
    for (int m = 1; m <= lags; ++m)
        for (int group = 0; group < 2; ++group, next += 2*SOLVER(S))
            for (int a = 0; a < count; ++a) {
                const lanes value = splat(part(&before[m][group*SOLVER(HAT) + start + a], 0));
                for (int i = 0; i < 2*SOLVER(S); ++i)
                    sum[group][a][i] += next[i]*value;
            }
    for (int a = 0; a < count; ++a)
        for (int i = 0; i < 2*SOLVER(S); ++i)
            y[i*N + start + a] = sum[0][a][i] + sum[1][a][i];
}

INLINE void SOLVER(stages_ahead)(const lanes *next, const lanes *const *before, int lags, lanes *y)
{
    int start = 0;
    for (; start + 4 <= N; start += 4)
        SOLVER(four_ahead)(next, before, lags, start, 4, y);
    if (N % 4 > 0)
        SOLVER(four_ahead)(next, before, lags, start, N % 4, y);
}
#else
/* Coefficients of four rows stand together; rows are the stages of L, then those of L^. */
enum { SOLVER(ROWS) = 2*SOLVER(S), SOLVER(BLOCK) = 4 };

/* Where the coefficient of regressor k for a stage of L (group 0) or L^ (1) stands. */
INLINE int SOLVER(coefficient)(int k, int group, int item)
{
    const int row = group*SOLVER(S) + item, first = row - row % SOLVER(BLOCK);
    const int rows = SOLVER(ROWS) - first < SOLVER(BLOCK) ? SOLVER(ROWS) - first : SOLVER(BLOCK);
    return first*KNOWN + k*rows + row % SOLVER(BLOCK);
}

/*
 * Numbers start..start + count - 1 of the rows row..row + rows - 1 of the next step: sums in
 * registers, each coefficient read once.
 */
INLINE void SOLVER(block_ahead)(const lanes *next, const lanes *const *before, int lags, int row,
    int rows, int start, int count, lanes *y)
{
    lanes sum[SOLVER(BLOCK)][4];
    LOAD_AGAIN(next);
    for (int i = 0; i < rows; ++i)
        for (int a = 0; a < count; ++a)
            sum[i][a] = splat(0);
    for (int k = 0; k < 2*LAST; ++k, next += rows) {
        const lanes *x = before[0] + k % 2*SOLVER(HAT) + stage_regarded(k/2)*N + start;
        for (int i = 0; i < rows; ++i)
            for (int a = 0; a < count; ++a)
                sum[i][a] += next[i]*x[a];
    }
    for (int m = 1; m <= lags; ++m)
        for (int group = 0; group < 2; ++group, next += rows) {
            const lanes *x = before[m] + group*SOLVER(HAT) + start;
            for (int i = 0; i < rows; ++i)
                for (int a = 0; a < count; ++a)
                    sum[i][a] += next[i]*x[a];
        }
    for (int i = 0; i < rows; ++i)
        for (int a = 0; a < count; ++a)
            y[(row + i)*N + start + a] = sum[i][a];
}

INLINE void SOLVER(rows_ahead)(const lanes *next, const lanes *const *before, int lags, int row,
    int rows, lanes *y)
{
    int start = 0;
    next += row*KNOWN;
    for (; start + 4 <= N; start += 4)
        SOLVER(block_ahead)(next, before, lags, row, rows, start, 4, y);
    if (N % 4 > 0)
        SOLVER(block_ahead)(next, before, lags, row, rows, start, N % 4, y);
}

INLINE void SOLVER(stages_ahead)(const lanes *next, const lanes *const *before, int lags, lanes *y)
{
    int row = 0;
    for (; row + SOLVER(BLOCK) <= SOLVER(ROWS); row += SOLVER(BLOCK))
        SOLVER(rows_ahead)(next, before, lags, row, SOLVER(BLOCK), y);
    if (SOLVER(ROWS) % SOLVER(BLOCK) > 0)
        SOLVER(rows_ahead)(next, before, lags, row, SOLVER(ROWS) % SOLVER(BLOCK), y);
}
#endif

/* The function for L and L^ of one trajectory, from equations of all coordinates. */
static void SOLVER(learn_stages)(SOLVER(t) *w, lesson_t *l, int track, int lags)
{
    SOLVER(lessons) *s = &w->lessons;
    const int steps = SOLVER(steps_recalled)(w), known = 2*(LAST + lags);
    const int available = (steps - 1 - lags)*N, stride = stride_of(available, known);
    const lanes *newest = SOLVER(recalled)(w, 1);
    begin_lesson(l, known, 2*S, (const real[2]){ SOLVER(ridge)(newest, SOLVER(HAT), track),
        SOLVER(ridge)(newest + SOLVER(HAT), SOLVER(HAT), track) });
    for (int e = 0; e < available; e += stride) {
        const int ago = 1 + e/N, a = e % N;
        real *row = next_row(l), *right = row + right_sides(l);
        for (int group = 0; group < 2; ++group) {
            const int at = group*SOLVER(HAT);
            const lanes *x = SOLVER(recalled)(w, ago) + at, *last = SOLVER(recalled)(w, ago + 1) + at;
            for (int j = 0; j < S; ++j)
                right[group*S + j] = SOLVER(number)(x, track, j, N, a);
            for (int j = 0; j < LAST; ++j)
                row[2*j + group] = SOLVER(number)(last, track, stage_regarded(j), N, a);
            for (int m = 0; m < lags; ++m)
                row[2*(LAST + m) + group] = SOLVER(number)(SOLVER(recalled)(w, ago + 2 + m) + at, track,
                    0, N, a);
        }
    }
    end_lesson(l);
    for (int k = 0; k < KNOWN; ++k)
        for (int j = 0; j < 2*S; ++j)
            set_part(&s->next[SOLVER(coefficient)(k, j/S, j % S/SOLVER(PER))], track + j % S % SOLVER(PER),
                learnt(l, k, j));
}

/* A lesson of one trajectory, and from then on a trial. */
NOINLINE void SOLVER(learn)(SOLVER(t) *w, int track)
{
    SOLVER(lessons) *s = &w->lessons;
    const int lags = lags_after(SOLVER(steps_recalled)(w));
    lesson_t lesson;
    if (lags < 0)
        return;
    SOLVER(learn_stages)(w, &lesson, track, lags);
    SOLVER(learn_nodes)(w, &lesson, track);
    s->lags = lags;
    s->latest[track] = w->predictor.count;
    s->trial[track] = 1;
}

/* What was learnt, one step on. */
NOINLINE void SOLVER(ahead)(const SOLVER(t) *w, lanes *x)
{
    const SOLVER(lessons) *s = &w->lessons;
    const lanes *before[LAGS + 1];
    for (int m = 0; m <= s->lags; ++m)
        before[m] = SOLVER(recalled)(w, 1 + m);
    SOLVER(stages_ahead)(s->next, before, s->lags, x);
    SOLVER(nodes_ahead)(w, x + SOLVER(IMPULSE));
}

/* Starting values by polynomials or a recurrence. */
INLINE void SOLVER(extrapolate)(SOLVER(t) *w)
{
    if (!w->predictor.fitted) {
        const lanes *x = SOLVER(recalled)(w, 1);
        SOLVER(stages_of_stages)(w->zero, 0, TABLE(onward), x, w->through);
        SOLVER(stages_of_stages)(w->zero, 0, TABLE(onward), x + SOLVER(HAT), w->through + SOLVER(HAT));
        SOLVER(continue_nodes)(w, x + SOLVER(IMPULSE), w->through + SOLVER(IMPULSE));
    }
    predict(&w->predictor, w->past, SOLVER(X), SOLVER(ends), w->through, w->now.x);
}

/* Whether all trajectories go by their functions for good: no recurrence is asked for any more. */
INLINE int SOLVER(all_settled)(const SOLVER(t) *w)
{
    int settled = 1;
    for (int i = 0; i < SOLVER(tracks)(w); ++i)
        settled &= w->lessons.settled[i];
    return settled;
}

/* Starting values from the past, of each trajectory by what is better for it. */
INLINE void SOLVER(foresee)(SOLVER(t) *w)
{
    SOLVER(lessons) *s = &w->lessons;
    const int tracks = SOLVER(tracks)(w);
    int taken = 0, trials = 0;
    for (int i = 0; i < tracks; ++i) {
        taken += s->taken[i];
        trials += s->trial[i];
    }
    if (SOLVER(all_settled)(w) || (trials == 0 && taken == tracks && w->predictor.fitted)) {
        SOLVER(ahead)(w, w->now.x);
        for (int e = 0; e < SOLVER(IMPULSE) && trials > 0; ++e)
            s->learnt[e] = w->now.x[e];
        return;
    }
    SOLVER(extrapolate)(w);
    if (trials == 0 && taken == 0)
        return;
    SOLVER(ahead)(w, s->learnt);
    for (int e = 0; e < SOLVER(IMPULSE); ++e)
        s->other[e] = w->now.x[e];
    for (int i = 0; i < tracks; ++i)
        for (int e = 0; e < SOLVER(X) && s->taken[i]; ++e)
            for (int j = i; j < i + SOLVER(PER); ++j)
                set_part(&w->now.x[e], j, part(&s->learnt[e], j));
}

/*
 * The trials that the step just done decides: what was learnt must be clearly better. That of the
 * second lesson decides for good, while nobody has trained a recurrence: a trajectory that goes by
 * what it learns does so whatever its mates do.
 */
static void SOLVER(decide)(SOLVER(t) *w)
{
    SOLVER(lessons) *s = &w->lessons;
    const real rough = 256*epsilon;
    lanes learnt = splat(0), other = splat(0);
    for (int e = 0; e < SOLVER(IMPULSE); ++e) {
        const lanes size = e < SOLVER(HAT) ? w->q_size : w->p_size;
        const lanes by_learnt = s->learnt[e] - w->now.x[e], by_other = s->other[e] - w->now.x[e];
        learnt += size*by_learnt*by_learnt;
        other += size*by_other*by_other;
    }
    for (int i = 0; i < SOLVER(tracks)(w); ++i) {
        if (!s->trial[i])
            continue;
        const real error = SOLVER(of_track)(&other, i);
        s->error[i] = SOLVER(of_track)(&learnt, i);
        if (!s->settled[i])
            s->taken[i] = 64*s->error[i] < error && error > rough*rough;
        if (s->latest[i] == SECOND_LESSON && w->predictor.count == SECOND_LESSON)
            s->settled[i] = s->taken[i];
        s->trial[i] = 0;
    }
}

/*
 * Records the step just done; for a recurrence only while somebody may ask for it. Lessons are few:
 * a motion that stays what it was needs no other, and none is given early where predictions are
 * close without. Where predictions have become much worse than they were there is one more.
 */
NOINLINE void SOLVER(remember)(SOLVER(t) *w)
{
    const real low = 64*epsilon, far = 16777216*epsilon;
    SOLVER(lessons) *s = &w->lessons;
    predictor_t *predictor = &w->predictor;
    const int fitted = predictor->fitted, tracks = SOLVER(tracks)(w);
    int trials = 0;
    for (int i = 0; i < tracks; ++i)
        trials += s->trial[i];
    if (trials > 0)
        SOLVER(decide)(w);
    if (SOLVER(all_settled)(w))
        note(predictor, w->past, SOLVER(X), w->now.x);
    else
        record(predictor, w->past, SOLVER(X), SOLVER(ends), SOLVER(rows), w->through, w->now.x);
    const long count = predictor->count;
    const int early = count == FIRST_LESSON || count == SECOND_LESSON;
    for (int i = 0; i < tracks; ++i) {
        const int worse = s->taken[i] && count >= s->latest[i] + HISTORY
            && !(predictor->first[i] < 4096*larger(s->error[i], low*low));
        const int rough = s->latest[i] > 0 || !(predictor->first[i] < far*far);
        if ((early && rough) || count == 24*HISTORY || worse)
            SOLVER(learn)(w, i);
        else if (s->latest[i] > 0 && fitted != predictor->fitted)
            s->trial[i] = 1;
    }
}

/* What is known of the past. */
static void SOLVER(forget)(SOLVER(t) *w)
{
    SOLVER(lessons) *s = &w->lessons;
    forget(&w->predictor);
    s->lags = s->order = 0;
    w->predictor.training = SECOND_LESSON + 3; /* when it is known who needs a recurrence */
    for (int i = 0; i < SOLVER(TRACKS); ++i) {
        s->taken[i] = s->settled[i] = s->trial[i] = 0;
        s->latest[i] = 0;
        s->error[i] = 0;
    }
    for (int k = 0; k < KNOWN*2*SOLVER(S); ++k)
        s->next[k] = splat(0);
    for (int k = 0; k < ORDER; ++k)
        s->wave[k] = splat(0);
}
