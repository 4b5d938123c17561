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

/* The first `count` numbers of an iterate, in the lanes of m. */
INLINE void keep(lanes_mask m, int count, const MANY(iterate) *from, MANY(iterate) *to)
{
    renew(m, count, (const lanes *)(const void *)from, (lanes *)(void *)to);
}

/*
 * The lanes in `fresh` begin at the rates at the start of the step (or, with x given, at those
 * unknowns); the others are not touched, to the bit.
 */
static void restart(batch_t *b, lanes_mask fresh, const real *x)
{
    b->kept = b->run.now;
    if (x == NULL)
        MANY(guess)(&b->run);
    for (int i = 0; i < LANES; ++i)
        if (x != NULL && holds(&fresh, i))
            MANY(load)(&b->run, i, x);
    MANY(begin)(&b->run);
    keep(lanes_others(fresh), WHOLE, &b->kept, &b->run.now);
}

/*
 * Sweeps until every lane has converged or given up. A lane ends with the sweep that is its own
 * last one: what it computes does not depend on its mates. lost[i] says why lane i gave up.
 */
static void sweep_lanes(batch_t *b, const options_t *options, const int *alive, int *lost,
    int *sweeps)
{
    MANY(t) *run = &b->run;
    const lanes far = splat((real)0.02);
    const int predicted = run->predictor.count > 0, watches = watches_rates(&run->predictor);
    lanes taken = splat(0), living = splat(0);
    for (int i = 0; i < LANES; ++i) {
        set_part(&living, i, (real)alive[i]);
        lost[i] = OK;
    }
    lanes_progress_t progress = lanes_start_of_sweeps();
    lanes_mask busy = living > splat(0), early = busy & lanes_others(busy);
    MANY(start)(run, predicted);
    for (int round = 1; lanes_any(busy); ++round) {
        MANY(sweep)(run);
        const lanes change = run->change;
        const lanes_mask on = lanes_goes_on(&progress, change, options->tolerance,
            options->max_iterations);
        if (!watches && !lanes_any(busy & lanes_others(on))) {
            lanes_go_on(&progress, change, run->bound.defect);
            taken = lanes_pick(busy, taken + 1, taken);
            continue;
        }
        const lanes_mask looks = busy & lanes_calls_for_look(&progress, change);
        if (lanes_any(looks)) {
            MANY(noise)(run);
            lanes_look(&progress, looks, run->noise);
        }
        lanes *rates = run->predictor.rate + rate_of(round);
        const lanes rate[2] = { rates[0], rates[1] };
        lanes_verdict_t verdict = lanes_judge(&progress, change, run->bound.defect, run->moved,
            options->tolerance, options->max_iterations, watches, rates);
        renew(lanes_others(busy), 2, rate, rates);
        taken = lanes_pick(busy, taken + 1, taken);
        if (predicted && round == 1) {
            const lanes_mask fresh = busy & lanes_others(change < far*far);
            for (int i = 0; i < LANES; ++i)
                if (holds(&busy, i))
                    run->predictor.first[i] = part(&change, i);
            if (lanes_any(fresh)) { /* a far prediction may lead to another root */
                const lanes_progress_t start = lanes_start_of_sweeps();
                renew(fresh, sizeof(progress)/sizeof(lanes), &start.sweeps, &progress.sweeps);
                restart(b, fresh, NULL);
            }
            verdict.ended &= lanes_others(fresh);
        }
        const lanes_mask ends = busy & verdict.ended;
        for (int i = 0; i < LANES; ++i)
            if (holds(&ends, i) && holds(&verdict.failed, i))
                lost[i] = why(part(&progress.change, i), part(&progress.before, i));
        busy &= lanes_others(ends);
        if (lanes_any(ends) && lanes_any(busy)) {
            early |= ends;
            keep(ends, MANY(RESULT), &run->now, &b->kept);
        }
        if (!predicted && lanes_any(busy) && (round == 1 || round == 3)) {
            MANY(sizes)(run);
            MANY(factor)(run);
        }
    }
    for (int i = 0; i < LANES; ++i)
        sweeps[i] += (int)part(&taken, i);
    if (lanes_any(early))
        keep(early, MANY(RESULT), &b->kept, &run->now);
}

/* Lane i by full Newton, as solver NEWTON does it. */
static int rescue(batch_t *b, const options_t *options, int lane, int *iterations, work_t *w)
{
    real q[N], p[N];
    int taken;
    get_constants(&b->run.constants, lane, &w->constants);
    for (int a = 0; a < N; ++a) {
        q[a] = part(&b->run.q[a], lane);
        p[a] = part(&b->run.p[a], lane);
    }
    const real dt = part(&b->run.h, lane);
    w->t = part(&b->run.t, lane);
    TIMED(w->span = part(&b->run.span, lane);)
    const int status = newton(w, options, dt, q, p, w->x, &taken);
    *iterations += taken;
    if (status != OK)
        return status;
    lanes number = splat(0);
    set_part(&number, lane, 1);
    restart(b, number > splat(0), w->x);
    return OK;
}

INLINE lanes lanes_size(lanes a)
{
    return lanes_larger(a, -a);
}
