/* --------------------------------------------------------------- several trajectories at a time */

/* What a caller's batch memory holds. */
typedef struct {
    MANY(t) run;
    MANY(iterate) kept; /* lanes that converged before their mates, or are to be kept */
    lanes energy_start, energy_error_max, energy_error_sum;
    lanes start; /* the time at the start of the run */
    long done;   /* steps since then */
    lanes g_max, g_sum, f_max, f_sum;
} batch_t;

_Static_assert(sizeof(batch_t) + 64 <= sizeof(((batch_memory *)0)->memory),
    "batch memory is too small");

static batch_t *batch_of(batch_memory *memory)
{
    return (batch_t *)(((size_t)memory->memory + 63) & ~(size_t)63);
}

enum { WHOLE = sizeof(MANY(iterate))/sizeof(lanes) };

/* The first `count` lanes of an iterate, for one trajectory. */
static void copy_lane(MANY(iterate) *to, const MANY(iterate) *from, int lane, int count)
{
    lanes *target = (lanes *)(void *)to;
    const lanes *source = (const lanes *)(const void *)from;
    for (int e = 0; e < count; ++e)
        set_part(&target[e], lane, part(&source[e], lane));
}

/*
 * The lanes marked in `fresh` begin at the rates at the start of the step (or, with x given, at
 * those unknowns); the others are not touched, to the bit.
 */
static void restart(batch_t *b, const int *fresh, const real *x)
{
    b->kept = b->run.now;
    if (x == NULL)
        MANY(guess)(&b->run);
    for (int i = 0; i < LANES; ++i)
        if (x != NULL && fresh[i])
            MANY(load)(&b->run, i, x);
    MANY(begin)(&b->run);
    for (int i = 0; i < LANES; ++i)
        if (!fresh[i])
            copy_lane(&b->run.now, &b->kept, i, WHOLE);
}

/*
 * Sweeps until every lane has converged or given up. A lane ends with the sweep that is its own
 * last one: what it computes does not depend on its mates. lost[i] says why lane i gave up.
 */
static void sweep_lanes(batch_t *b, const options_t *options, const int *alive, int *lost,
    int *sweeps)
{
    MANY(t) *run = &b->run;
    const real far = (real)0.02;
    const int predicted = run->predictor.count > 0;
    progress_t progress[LANES];
    int busy[LANES], early[LANES], fresh[LANES], left = 0;
    for (int i = 0; i < LANES; ++i) {
        progress[i] = start_of_sweeps(run->predictor.rate[i]);
        busy[i] = alive[i];
        early[i] = lost[i] = 0;
        left += alive[i];
    }
    MANY(start)(run, predicted);
    for (int round = 1; left > 0; ++round) {
        int again = 0, looks = 0;
        MANY(sweep)(run);
        for (int i = 0; i < LANES; ++i)
            looks |= busy[i] && calls_for_look(&progress[i], part(&run->change, i));
        if (looks)
            MANY(noise)(run);
        for (int i = 0; i < LANES; ++i) {
            fresh[i] = 0;
            if (!busy[i])
                continue;
            const real change = part(&run->change, i), defect = part(&run->bound.defect, i);
            if (calls_for_look(&progress[i], change))
                look(&progress[i], part(&run->noise, i));
            const enum verdict verdict = judge(&progress[i], change, defect,
                part(&run->moved, i), options->tolerance, options->max_iterations);
            ++sweeps[i];
            if (predicted && round == 1)
                run->predictor.first[i] = change;
            if (predicted && round == 1 && !(change < far*far)) {
                fresh[i] = again = 1; /* a far prediction may lead to another root */
                progress[i] = start_of_sweeps(run->predictor.rate[i]);
            } else if (verdict != SWEEP_AGAIN) {
                busy[i] = 0;
                lost[i] = verdict == GIVE_UP ? why(&progress[i]) : OK;
                early[i] = 1;
                --left;
            }
        }
        if (again)
            restart(b, fresh, NULL);
        for (int i = 0; i < LANES && left > 0; ++i)
            if (early[i] == 1) {
                early[i] = 2;
                copy_lane(&b->kept, &run->now, i, MANY(RESULT));
            }
        if (!predicted && left > 0 && (round == 1 || round == 3)) {
            MANY(sizes)(run);
            MANY(factor)(run);
        }
    }
    for (int i = 0; i < LANES; ++i) {
        run->predictor.rate[i] = progress[i].rate;
        if (early[i] == 2)
            copy_lane(&run->now, &b->kept, i, MANY(RESULT));
    }
}

/* Lane i by full Newton, as solver NEWTON does it. */
static int rescue(batch_t *b, const options_t *options, int lane, int *iterations, work_t *w)
{
    real q[N], p[N];
    int fresh[LANES] = { 0 }, taken;
    get_constants(&b->run.constants, lane, &w->constants);
    for (int a = 0; a < N; ++a) {
        q[a] = part(&b->run.q[a], lane);
        p[a] = part(&b->run.p[a], lane);
    }
    const real dt = part(&b->run.h, lane);
    w->t = part(&b->run.t, lane);
    TIMED(w->span = part(&b->run.span, lane);)
    guess(w, dt, q, p, w->x);
    const int status = newton(w, options, dt, q, p, w->x, &taken);
    *iterations += taken;
    if (status != OK)
        return status;
    fresh[lane] = 1;
    restart(b, fresh, w->x);
    return OK;
}

/* Larger of two, lane by lane */
INLINE lanes lanes_larger(lanes a, lanes b)
{
    lanes result = a;
    for (int i = 0; i < LANES; ++i)
        set_part(&result, i, larger(part(&b, i), part(&a, i)));
    return result;
}

INLINE lanes lanes_size(lanes a)
{
    lanes result = a;
    for (int i = 0; i < LANES; ++i)
        set_part(&result, i, MATH(fabs)(part(&a, i)));
    return result;
}
