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
    real defect; /* of the constraints in the last sweep, relative to the state */
    real least_defect;
    real rate;   /* mean ratio of two changes far from round-off, in this step or an earlier one */
} progress_t;

enum verdict { SWEEP_AGAIN, CONVERGED, GIVE_UP };

static progress_t start_of_sweeps(real rate)
{
    const real huge = (real)HUGE_VAL;
    const progress_t start = { .floor = 16*epsilon, .least = huge, .defect = huge,
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
 * Ends the sweeps when the next change would be far below round-off, or when changes near
 * round-off have stopped shrinking, unless the constraints are still coming nearer; gives up when
 * changes grow, or would not get there in time. Modes may alternate: rates are those of the last
 * two sweeps together.
 */
static enum verdict judge(progress_t *s, real change, real defect, real tolerance, int most)
{
    const real beyond = epsilon/4096, fast = (real)0.05, low = 4096*epsilon;
    const real ratio = change/s->change, of_two = change/s->before;
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
    if (change < low*low && s->sweeps > 3 && !(s->before < low*low))
        s->rate = MATH(pow)(s->before/s->first, 1/(real)(s->sweeps - 2));
    if (change <= tolerance*tolerance)
        return CONVERGED;
    /* Two sweeps do not tell the slow modes: count on no less than a hundredth of the change. */
    const real next = larger(ratio, s->sweeps == 2 ? (real)0.0001 : MATH(sqrt)(of_two));
    if (met && change*next < beyond*beyond)
        return CONVERGED;
    const int stalled = near && (s->rate < fast ? ratio > 4*fast : !least);
    s->calm = stalled ? s->calm + 1 : s->rate < fast ? s->calm : 0;
    if (met && stalled && (s->calm >= (s->rate < fast ? 2 : 4) || change < epsilon*epsilon))
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
