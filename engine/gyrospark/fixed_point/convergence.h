/* The convergence test of the fixed-point iteration. */

/* ------------------------------------------------------------------- when a sweep has converged */

/* What is known of the sweeps of one step, in numbers alone. Changes and defects are squares. */
typedef struct {
    NUMBER sweeps;
    NUMBER turn;   /* the same modulo 8 */
    NUMBER calm;   /* sweeps near round-off that brought nothing more */
    NUMBER idle;   /* sweeps that brought the constraints no nearer */
    NUMBER looked; /* 1 where the floor is what rounding was seen to be worth */
    NUMBER floor;  /* changes below it may be rounding: a size, no square */
    NUMBER change; /* of the last sweep: the sum of its squared increments relative to the state */
    NUMBER before; /* of the sweep before it */
    NUMBER first;  /* of the first */
    NUMBER least;  /* of all sweeps */
    NUMBER left;   /* expected of the next sweep, were it not for rounding; far from that huge */
    NUMBER defect; /* of the constraints in the last sweep, relative to the state */
    NUMBER least_defect;
} TYPED(progress_t);

/* Where the sweeps have ended, and where they did without success. */
typedef struct {
    TYPED(mask) ended, failed;
} TYPED(verdict_t);

static TYPED(progress_t) TYPED(start_of_sweeps)(void)
{
    const NUMBER none = TYPED(all)(0), huge = TYPED(all)((real)HUGE_VAL), floor = TYPED(all)(16*epsilon);
    const TYPED(progress_t) start = { none, none, none, none, none, floor, none, none, none, huge,
        huge, huge, huge };
    return start;
}

/*
 * Where a change that hardly shrank, above the floor, calls for a look at what rounding is worth:
 * a stiff spring k rounds its force by epsilon k |q|, whatever the momentum.
 */
INLINE TYPED(mask) TYPED(calls_for_look)(const TYPED(progress_t) *s, NUMBER change)
{
    return (s->looked < 1) & (s->sweeps > 2) & (change > s->change/4)
        & TYPED(others)(change < s->floor*s->floor);
}

/* `noise` is what stages some units in the last place away change in a sweep, squared. */
static void TYPED(look)(TYPED(progress_t) *s, TYPED(mask) looks, NUMBER noise)
{
    s->looked = TYPED(pick)(looks, TYPED(all)(1), s->looked);
    s->floor = TYPED(pick)(looks, TYPED(larger)(s->floor, 16*TYPED(root)(noise)), s->floor);
}

/* What constraints have come to. */
INLINE void TYPED(note_defect)(TYPED(progress_t) *s, NUMBER defect)
{
    s->idle = TYPED(pick)(defect < (real)0.8*s->least_defect, TYPED(all)(0), s->idle + 1);
    s->defect = defect;
    s->least_defect = TYPED(pick)(defect < s->least_defect, defect, s->least_defect);
}

/*
 * A sweep far from rounding that shrank what it changes goes on whatever else is true of it, and
 * little is noted of it. Not so every eighth, nor one that calls for a look.
 */
INLINE TYPED(mask) TYPED(goes_on)(const TYPED(progress_t) *s, NUMBER change, real tolerance, int most)
{
    return (change < s->change) & (s->sweeps > 0) & (s->turn < 7) & (s->sweeps < (real)most - 2)
        & (change < 9) & (change > tolerance*tolerance) & TYPED(others)(change < s->floor*s->floor)
        & TYPED(others)(TYPED(calls_for_look)(s, change));
}

/* All that a verdict would note of it. */
INLINE void TYPED(go_on)(TYPED(progress_t) *s, NUMBER change, NUMBER defect)
{
    s->before = s->change;
    s->change = change;
    s->least = TYPED(smaller)(change, s->least);
    s->sweeps += 1;
    s->turn += 1;
    s->calm = TYPED(all)(0);
    s->left = TYPED(all)((real)HUGE_VAL);
    TYPED(note_defect)(s, defect);
}

/* Whether the next sweep would leave no more of the constraints than rounding does, or cannot. */
INLINE TYPED(mask) TYPED(is_met)(TYPED(progress_t) *s, NUMBER defect)
{
    const real floor = 4*epsilon*epsilon;
    const real low = 4096*epsilon; /* above that, constraints that idle are not met */
    const TYPED(mask) next = (defect*defect <= floor*s->defect) & ((real)0.0001*defect <= floor);
    TYPED(note_defect)(s, defect);
    return (defect <= floor) | next | ((s->idle > 2) & (defect < low*low));
}

/* A rate that was never seen is that of the sweep before it, below 0; 1 where there is none. */
INLINE NUMBER TYPED(size_of_rate)(NUMBER rate)
{
    return TYPED(larger)(rate, -rate);
}

/*
 * By how much this sweep shrinks a change, rates[0], is noted wherever a change that does so would
 * still be clear of rounding, whatever it then is: if large ones alone were, the mean would be too
 * large. Each sweep has its own: the first ones shrink less than those that follow.
 */
INLINE void TYPED(watch)(const TYPED(progress_t) *s, NUMBER change, NUMBER rate, NUMBER *rates)
{
    const NUMBER known = TYPED(size_of_rate)(rates[0]);
    const TYPED(mask) old = (rates[0] > 0) & (rates[0] < 1), next = (rates[1] > 0) & (rates[1] < 1);
    const TYPED(mask) clear = (known >= 1) | (16*s->before*known > s->floor*s->floor);
    const TYPED(mask) seen = (s->sweeps > 1) & (rate < 1) & (change < 9) & clear;
    const NUMBER mean = TYPED(pick)(old, rates[0] + (rate - rates[0])/8, rate);
    rates[0] = TYPED(pick)(seen, mean, rates[0]);
    rates[1] = TYPED(pick)(next, rates[1], -TYPED(size_of_rate)(rates[0]));
}

/*
 * What is left after a sweep near rounding, where changes tell nothing any more: it goes on
 * shrinking as it is known to do, or as it did in this step where nothing is known.
 */
INLINE NUMBER TYPED(what_is_left)(const TYPED(progress_t) *s, TYPED(mask) near, NUMBER change, NUMBER ratio,
    NUMBER rate, const NUMBER *rates)
{
    /* Few sweeps do not tell the slow modes: count on no less than a hundredth of the change. */
    const NUMBER slow = TYPED(all)((real)0.0001);
    const NUMBER next = TYPED(larger)(ratio, TYPED(pick)(s->sweeps < 3, slow, rate));
    const NUMBER known = TYPED(size_of_rate)(rates[1]);
    const NUMBER usual = TYPED(larger)(slow, TYPED(pick)(known < 1, known, next));
    return TYPED(pick)(near, TYPED(smaller)(s->left, change)*usual, TYPED(all)((real)HUGE_VAL));
}

/* Where changes at the rate of all sweeps so far would not come to the floor in time. */
NOINLINE TYPED(mask) TYPED(is_late)(const TYPED(progress_t) *s, int most)
{
    const NUMBER left = ((real)most - s->sweeps)/(s->sweeps - 1);
    const NUMBER last = s->change*TYPED(power)(s->change/s->first, left);
    return last > s->floor*s->floor;
}

/*
 * Ends the sweeps when what is left is far below what rounding is worth in a step that has `moved`
 * the state (squared and relative): it adds up from step to step, as it is not random. Or when
 * changes near round-off have stopped shrinking. Not while the constraints are still coming nearer.
 * They fail when changes grow, or would not get there in time. Each lane by itself: what it comes
 * to depends on no other.
 */
static TYPED(verdict_t) TYPED(judge)(TYPED(progress_t) *s, NUMBER change, NUMBER defect, NUMBER moved,
    real tolerance, int most, int watches, NUMBER *rates)
{
    const NUMBER floor = s->floor*s->floor, round_off = epsilon*epsilon*moved;
    const NUMBER noise = TYPED(pick)(s->looked > 0, TYPED(larger)(round_off, floor/256), round_off);
    const NUMBER ratio = change/s->change, two_ago = s->before, of_two = change/two_ago;
    const NUMBER rate = TYPED(root)(of_two);
    const TYPED(mask) near = change < floor, far = TYPED(others)(near), met = TYPED(is_met)(s, defect);
    const TYPED(mask) stalls = near & TYPED(others)(change < s->least);
    s->before = s->change;
    s->change = change;
    s->least = TYPED(smaller)(change, s->least);
    s->sweeps += 1;
    s->turn = TYPED(pick)(s->turn < 7, s->turn + 1, TYPED(all)(0));
    const TYPED(mask) one = s->sweeps < 2, over = s->sweeps > (real)most;
    s->first = TYPED(pick)(one, change, s->first);
    if (watches)
        TYPED(watch)(s, change, TYPED(pick)(s->sweeps < 3, ratio, rate), rates);
    s->left = TYPED(what_is_left)(s, near, change, ratio, rate, rates);
    s->calm = TYPED(pick)(stalls, s->calm + 1, TYPED(all)(0));
    const TYPED(mask) small = (change <= tolerance*tolerance)
        | (met & ((65536*s->left < noise) | (s->calm > 3)));
    const TYPED(mask) bounded = change < 9, grows = (ratio > 1) & (of_two > 1);
    const TYPED(mask) late = far & TYPED(others)(one) & (s->turn < 1);
    const TYPED(mask) done = TYPED(pick_mask)(one, change <= 0, bounded & small);
    TYPED(mask) failed = TYPED(pick_mask)(one, TYPED(others)(change >= 0), TYPED(others)(bounded)
        | (s->sweeps > (real)most - 1) | (grows & far & (s->sweeps > 3)));
    if (TYPED(any)(late & TYPED(others)(failed)))
        failed |= late & TYPED(is_late)(s, most);
    const TYPED(verdict_t) verdict = { done | failed | over, over | (failed & TYPED(others)(done)) };
    return verdict;
}
