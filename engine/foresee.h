/* The function for L and L^ of one trajectory, from equations of all coordinates. */
static void RUN(learn_stages)(RUN(t) *w, lesson_t *l, int track, int lags)
{
    RUN(lessons) *s = &w->lessons;
    const int steps = RUN(steps_recalled)(w), known = 2*(LAST + lags);
    const int available = (steps - 1 - lags)*N, stride = stride_of(available, known);
    const lanes *newest = RUN(recalled)(w, 1);
    begin_lesson(l, known, 2*S, (const real[2]){ RUN(ridge)(newest, RUN(HAT), track),
        RUN(ridge)(newest + RUN(HAT), RUN(HAT), track) });
    for (int e = 0; e < available; e += stride) {
        const int ago = 1 + e/N, a = e % N;
        real *row = next_row(l), *right = row + right_sides(l);
        for (int group = 0; group < 2; ++group) {
            const int at = group*RUN(HAT);
            const lanes *x = RUN(recalled)(w, ago) + at, *last = RUN(recalled)(w, ago + 1) + at;
            for (int j = 0; j < S; ++j)
                right[group*S + j] = RUN(number)(x, track, j, N, a);
            for (int j = 0; j < LAST; ++j)
                row[2*j + group] = RUN(number)(last, track, stage_regarded(j), N, a);
            for (int m = 0; m < lags; ++m)
                row[2*(LAST + m) + group] = RUN(number)(RUN(recalled)(w, ago + 2 + m) + at, track,
                    0, N, a);
        }
    }
    end_lesson(l);
    for (int k = 0; k < KNOWN; ++k)
        for (int j = 0; j < 2*S; ++j)
            set_part(&s->next[RUN(coefficient)(k, j/S, j % S/RUN(PER))], track + j % S % RUN(PER),
                learnt(l, k, j));
}

/* A lesson of one trajectory, and from then on a trial. */
NOINLINE void RUN(learn)(RUN(t) *w, int track)
{
    RUN(lessons) *s = &w->lessons;
    const int lags = lags_after(RUN(steps_recalled)(w));
    lesson_t lesson;
    if (lags < 0)
        return;
    RUN(learn_stages)(w, &lesson, track, lags);
    RUN(learn_nodes)(w, &lesson, track);
    s->lags = lags;
    s->latest[track] = w->predictor.count;
    s->trial[track] = 1;
}

/* What was learnt, one step on. */
NOINLINE void RUN(ahead)(const RUN(t) *w, lanes *x)
{
    const RUN(lessons) *s = &w->lessons;
    const lanes *before[LAGS + 1];
    for (int m = 0; m <= s->lags; ++m)
        before[m] = RUN(recalled)(w, 1 + m);
    RUN(stages_ahead)(s->next, before, s->lags, x);
    RUN(nodes_ahead)(w, x + RUN(IMPULSE));
}

/* Starting values by polynomials or a recurrence. */
INLINE void RUN(extrapolate)(RUN(t) *w)
{
    if (!w->predictor.fitted) {
        const lanes *x = RUN(recalled)(w, 1);
        RUN(stages_of_stages)(w->zero, 0, TABLE(onward), x, w->through);
        RUN(stages_of_stages)(w->zero, 0, TABLE(onward), x + RUN(HAT), w->through + RUN(HAT));
        RUN(continue_nodes)(w, x + RUN(IMPULSE), w->through + RUN(IMPULSE));
    }
    predict(&w->predictor, w->past, RUN(X), RUN(ends), w->through, w->now.x);
}

/* Whether all trajectories go by their functions for good: no recurrence is asked for any more. */
INLINE int RUN(all_settled)(const RUN(t) *w)
{
    int settled = 1;
    for (int i = 0; i < RUN(tracks)(w); ++i)
        settled &= w->lessons.settled[i];
    return settled;
}

/* Starting values from the past, of each trajectory by what is better for it. */
INLINE void RUN(foresee)(RUN(t) *w)
{
    RUN(lessons) *s = &w->lessons;
    const int tracks = RUN(tracks)(w);
    int taken = 0, trials = 0;
    for (int i = 0; i < tracks; ++i) {
        taken += s->taken[i];
        trials += s->trial[i];
    }
    if (RUN(all_settled)(w) || (trials == 0 && taken == tracks && w->predictor.fitted)) {
        RUN(ahead)(w, w->now.x);
        for (int e = 0; e < RUN(IMPULSE) && trials > 0; ++e)
            s->learnt[e] = w->now.x[e];
        return;
    }
    RUN(extrapolate)(w);
    if (trials == 0 && taken == 0)
        return;
    RUN(ahead)(w, s->learnt);
    for (int e = 0; e < RUN(IMPULSE); ++e)
        s->other[e] = w->now.x[e];
    for (int i = 0; i < tracks; ++i)
        for (int e = 0; e < RUN(X) && s->taken[i]; ++e)
            for (int j = i; j < i + RUN(PER); ++j)
                set_part(&w->now.x[e], j, part(&s->learnt[e], j));
}

/*
 * The trials that the step just done decides: what was learnt must be clearly better. That of the
 * second lesson decides for good, while nobody has trained a recurrence: a trajectory that goes by
 * what it learns does so whatever its mates do.
 */
static void RUN(decide)(RUN(t) *w)
{
    RUN(lessons) *s = &w->lessons;
    const real rough = 256*epsilon;
    lanes learnt = splat(0), other = splat(0);
    for (int e = 0; e < RUN(IMPULSE); ++e) {
        const lanes size = e < RUN(HAT) ? w->q_size : w->p_size;
        const lanes by_learnt = s->learnt[e] - w->now.x[e], by_other = s->other[e] - w->now.x[e];
        learnt += size*by_learnt*by_learnt;
        other += size*by_other*by_other;
    }
    for (int i = 0; i < RUN(tracks)(w); ++i) {
        if (!s->trial[i])
            continue;
        const real error = RUN(of_track)(&other, i);
        s->error[i] = RUN(of_track)(&learnt, i);
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
NOINLINE void RUN(remember)(RUN(t) *w)
{
    const real low = 64*epsilon, far = 16777216*epsilon;
    RUN(lessons) *s = &w->lessons;
    predictor_t *predictor = &w->predictor;
    const int fitted = predictor->fitted, tracks = RUN(tracks)(w);
    int trials = 0;
    for (int i = 0; i < tracks; ++i)
        trials += s->trial[i];
    if (trials > 0)
        RUN(decide)(w);
    if (RUN(all_settled)(w))
        note(predictor, w->past, RUN(X), w->now.x);
    else
        record(predictor, w->past, RUN(X), RUN(ends), RUN(rows), w->through, w->now.x);
    const long count = predictor->count;
    const int early = count == FIRST_LESSON || count == SECOND_LESSON;
    for (int i = 0; i < tracks; ++i) {
        const int worse = s->taken[i] && count >= s->latest[i] + HISTORY
            && !(predictor->first[i] < 4096*larger(s->error[i], low*low));
        const int rough = s->latest[i] > 0 || !(predictor->first[i] < far*far);
        if ((early && rough) || count == 24*HISTORY || worse)
            RUN(learn)(w, i);
        else if (s->latest[i] > 0 && fitted != predictor->fitted)
            s->trial[i] = 1;
    }
}

/* What is known of the past. */
static void RUN(forget)(RUN(t) *w)
{
    RUN(lessons) *s = &w->lessons;
    forget(&w->predictor);
    s->lags = s->order = 0;
    w->predictor.training = SECOND_LESSON + 3; /* when it is known who needs a recurrence */
    for (int i = 0; i < RUN(TRACKS); ++i) {
        s->taken[i] = s->settled[i] = s->trial[i] = 0;
        s->latest[i] = 0;
        s->error[i] = 0;
    }
    for (int k = 0; k < KNOWN*2*RUN(S); ++k)
        s->next[k] = splat(0);
    for (int k = 0; k < ORDER; ++k)
        s->wave[k] = splat(0);
}
