/* ------------------------------------------------------------------- when a sweep has converged */

/* What is known of the sweeps of one step, of one trajectory. Changes and defects are squares. */
typedef struct {
    int sweeps;
    int calm;    /* sweeps near round-off that brought nothing more */
    int idle;    /* sweeps that brought the constraints no nearer */
    int looked;  /* whether the floor is what rounding was seen to be worth */
    real floor;  /* changes below it may be rounding: a size, no square */
    real change; /* of the last sweep: the sum of its squared increments relative to the state */
    real before; /* of the sweep before it */
    real first;  /* of the first */
    real least;  /* of all sweeps */
    real left;   /* what is expected of the next sweep, were it not for rounding */
    real defect; /* of the constraints in the last sweep, relative to the state */
    real least_defect;
    real rate;   /* ratio of two changes far from round-off, the mean of many steps */
    real seen;   /* the same, last seen in this step */
} progress_t;

enum verdict { SWEEP_AGAIN, CONVERGED, GIVE_UP };

static progress_t start_of_sweeps(real rate)
{
    const real huge = (real)HUGE_VAL;
    const progress_t start = { .floor = 16*epsilon, .least = huge, .left = huge, .defect = huge,
        .least_defect = huge, .rate = rate };
    return start;
}

/*
 * Whether a change that hardly shrank, above the floor, calls for a look at what rounding is worth:
 * a stiff spring k rounds its force by epsilon k |q|, whatever the momentum.
 */
static int calls_for_look(const progress_t *s, real change)
{
    return !s->looked && s->sweeps >= 2 && change > s->change/4 && !(change < s->floor*s->floor);
}

/* `noise` is what stages some units in the last place away change in a sweep, squared. */
static void look(progress_t *s, real noise)
{
    s->looked = 1;
    s->floor = larger(s->floor, 16*MATH(sqrt)(noise));
}

/* Whether the next sweep would leave no more of the constraints than rounding does, or cannot. */
static int is_met(progress_t *s, real defect)
{
    const real next = defect*larger(defect/s->defect, (real)0.0001);
    s->idle = defect < (real)0.8*s->least_defect ? 0 : s->idle + 1;
    s->defect = defect;
    if (defect < s->least_defect)
        s->least_defect = defect;
    const real floor = 4*epsilon*epsilon;
    const real low = 4096*epsilon; /* above that, constraints that idle are not met */
    return defect <= floor || !(next > floor) || (s->idle > 2 && defect < low*low);
}

/*
 * The rate of two sweeps together, for modes may alternate; not of the first, which has the changes
 * of a prediction. It is noted wherever a change that shrinks at the known rate would still be
 * clear of rounding, whatever it then is: if large ones alone were, the mean would be too large.
 */
static void watch(progress_t *s, real change, real two_ago)
{
    const int unknown = !(s->rate < 1);
    const int clear = unknown || 16*two_ago*s->rate*s->rate > s->floor*s->floor;
    if (s->sweeps < 4 || !(change < two_ago) || !clear)
        return;
    s->seen = MATH(sqrt)(change/two_ago);
    s->rate = unknown ? s->seen : s->rate + (s->seen - s->rate)/16;
}

/*
 * What is left after a sweep. Far from rounding this step's own rates tell it. Near it they tell
 * nothing, but what is left goes on shrinking there as it did before.
 */
static real what_is_left(const progress_t *s, real change, real ratio, real of_two)
{
    /* Few sweeps do not tell the slow modes: count on no less than a hundredth of the change. */
    const real slow = (real)0.0001, usual = larger(slow, larger(s->rate, s->seen));
    const real next = larger(ratio, s->sweeps == 2 ? slow : MATH(sqrt)(of_two));
    if (!(change < s->floor*s->floor))
        return change*larger(next, usual);
    return (s->left < change ? s->left : change)*(usual < next ? usual : next);
}

/*
 * Ends the sweeps when what is left is far below what rounding is worth in a step that has `moved`
 * the state (squared and relative): it adds up from step to step, as it is not random. Or when
 * changes near round-off have stopped shrinking. Not while the constraints are still coming nearer.
 * Gives up when changes grow, or would not get there in time.
 */
static enum verdict judge(progress_t *s, real change, real defect, real moved, real tolerance,
    int most)
{
    const real round_off = epsilon*epsilon*moved;
    const real noise = s->looked ? larger(round_off, s->floor*s->floor/256) : round_off;
    const real ratio = change/s->change, two_ago = s->before, of_two = change/two_ago;
    const int near = change < s->floor*s->floor, least = change < s->least, met = is_met(s, defect);
    s->before = s->change;
    s->change = change;
    if (least)
        s->least = change;
    if (++s->sweeps > most)
        return GIVE_UP;
    if (s->sweeps == 1) {
        s->first = change;
        return change > 0 ? SWEEP_AGAIN : isnan(change) ? GIVE_UP : CONVERGED;
    }
    if (!(change < 9))
        return GIVE_UP;
    watch(s, change, two_ago);
    if (change <= tolerance*tolerance)
        return CONVERGED;
    s->left = what_is_left(s, change, ratio, of_two);
    if (met && 65536*s->left < noise)
        return CONVERGED;
    s->calm = near && !least ? s->calm + 1 : 0;
    if (met && s->calm >= 4)
        return CONVERGED;
    if (s->sweeps == most || (ratio > 1 && of_two > 1 && !near && s->sweeps > 3))
        return GIVE_UP;
    if (s->sweeps % 8 == 0 && !near) { /* at the rate of all sweeps so far: would it get there? */
        const real left = (real)(most - s->sweeps)/(real)(s->sweeps - 1);
        if (change*MATH(pow)(change/s->first, left) > s->floor*s->floor)
            return GIVE_UP;
    }
    return SWEEP_AGAIN;
}

/* Why the sweeps of a step were given up. */
static int why(const progress_t *s)
{
    return failure(MATH(sqrt)(s->change), s->before > 0 ? MATH(sqrt)(s->change/s->before) : 0);
}
