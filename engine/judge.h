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
} ON(progress_t);

/* Where the sweeps have ended, and where they did without success. */
typedef struct {
    ON(mask) ended, failed;
} ON(verdict_t);

static ON(progress_t) ON(start_of_sweeps)(void)
{
    const NUMBER none = ON(all)(0), huge = ON(all)((real)HUGE_VAL), floor = ON(all)(16*epsilon);
    const ON(progress_t) start = { none, none, none, none, none, floor, none, none, none, huge,
        huge, huge, huge };
    return start;
}

/*
 * Where a change that hardly shrank, above the floor, calls for a look at what rounding is worth:
 * a stiff spring k rounds its force by epsilon k |q|, whatever the momentum.
 */
INLINE ON(mask) ON(calls_for_look)(const ON(progress_t) *s, NUMBER change)
{
    return (s->looked < 1) & (s->sweeps > 2) & (change > s->change/4)
        & ON(others)(change < s->floor*s->floor);
}

/* `noise` is what stages some units in the last place away change in a sweep, squared. */
static void ON(look)(ON(progress_t) *s, ON(mask) looks, NUMBER noise)
{
    s->looked = ON(pick)(looks, ON(all)(1), s->looked);
    s->floor = ON(pick)(looks, ON(larger)(s->floor, 16*ON(root)(noise)), s->floor);
}

/* What constraints have come to. */
INLINE void ON(note_defect)(ON(progress_t) *s, NUMBER defect)
{
    s->idle = ON(pick)(defect < (real)0.8*s->least_defect, ON(all)(0), s->idle + 1);
    s->defect = defect;
    s->least_defect = ON(pick)(defect < s->least_defect, defect, s->least_defect);
}

/*
 * A sweep far from rounding that shrank what it changes goes on whatever else is true of it, and
 * little is noted of it. Not so every eighth, nor one that calls for a look.
 */
INLINE ON(mask) ON(goes_on)(const ON(progress_t) *s, NUMBER change, real tolerance, int most)
{
    return (change < s->change) & (s->sweeps > 0) & (s->turn < 7) & (s->sweeps < (real)most - 2)
        & (change < 9) & (change > tolerance*tolerance) & ON(others)(change < s->floor*s->floor)
        & ON(others)(ON(calls_for_look)(s, change));
}

/* All that a verdict would note of it. */
INLINE void ON(go_on)(ON(progress_t) *s, NUMBER change, NUMBER defect)
{
    s->before = s->change;
    s->change = change;
    s->least = ON(smaller)(change, s->least);
    s->sweeps += 1;
    s->turn += 1;
    s->calm = ON(all)(0);
    s->left = ON(all)((real)HUGE_VAL);
    ON(note_defect)(s, defect);
}

/* Whether the next sweep would leave no more of the constraints than rounding does, or cannot. */
INLINE ON(mask) ON(is_met)(ON(progress_t) *s, NUMBER defect)
{
    const real floor = 4*epsilon*epsilon;
    const real low = 4096*epsilon; /* above that, constraints that idle are not met */
    const ON(mask) next = (defect*defect <= floor*s->defect) & ((real)0.0001*defect <= floor);
    ON(note_defect)(s, defect);
    return (defect <= floor) | next | ((s->idle > 2) & (defect < low*low));
}

/* A rate that was never seen is that of the sweep before it, below 0; 1 where there is none. */
INLINE NUMBER ON(size_of_rate)(NUMBER rate)
{
    return ON(larger)(rate, -rate);
}

/*
 * By how much this sweep shrinks a change, rates[0], is noted wherever a change that does so would
 * still be clear of rounding, whatever it then is: if large ones alone were, the mean would be too
 * large. Each sweep has its own: the first ones shrink less than those that follow.
 */
INLINE void ON(watch)(const ON(progress_t) *s, NUMBER change, NUMBER rate, NUMBER *rates)
{
    const NUMBER known = ON(size_of_rate)(rates[0]);
    const ON(mask) old = (rates[0] > 0) & (rates[0] < 1), next = (rates[1] > 0) & (rates[1] < 1);
    const ON(mask) clear = (known >= 1) | (16*s->before*known > s->floor*s->floor);
    const ON(mask) seen = (s->sweeps > 1) & (rate < 1) & (change < 9) & clear;
    const NUMBER mean = ON(pick)(old, rates[0] + (rate - rates[0])/8, rate);
    rates[0] = ON(pick)(seen, mean, rates[0]);
    rates[1] = ON(pick)(next, rates[1], -ON(size_of_rate)(rates[0]));
}

/*
 * What is left after a sweep near rounding, where changes tell nothing any more: it goes on
 * shrinking as it is known to do, or as it did in this step where nothing is known.
 */
INLINE NUMBER ON(what_is_left)(const ON(progress_t) *s, ON(mask) near, NUMBER change, NUMBER ratio,
    NUMBER rate, const NUMBER *rates)
{
    /* Few sweeps do not tell the slow modes: count on no less than a hundredth of the change. */
    const NUMBER slow = ON(all)((real)0.0001);
    const NUMBER next = ON(larger)(ratio, ON(pick)(s->sweeps < 3, slow, rate));
    const NUMBER known = ON(size_of_rate)(rates[1]);
    const NUMBER usual = ON(larger)(slow, ON(pick)(known < 1, known, next));
    return ON(pick)(near, ON(smaller)(s->left, change)*usual, ON(all)((real)HUGE_VAL));
}

/* Where changes at the rate of all sweeps so far would not come to the floor in time. */
NOINLINE ON(mask) ON(is_late)(const ON(progress_t) *s, int most)
{
    const NUMBER left = ((real)most - s->sweeps)/(s->sweeps - 1);
    const NUMBER last = s->change*ON(power)(s->change/s->first, left);
    return last > s->floor*s->floor;
}

/*
 * Ends the sweeps when what is left is far below what rounding is worth in a step that has `moved`
 * the state (squared and relative): it adds up from step to step, as it is not random. Or when
 * changes near round-off have stopped shrinking. Not while the constraints are still coming nearer.
 * They fail when changes grow, or would not get there in time. Each lane by itself: what it comes
 * to depends on no other.
 */
static ON(verdict_t) ON(judge)(ON(progress_t) *s, NUMBER change, NUMBER defect, NUMBER moved,
    real tolerance, int most, int watches, NUMBER *rates)
{
    const NUMBER floor = s->floor*s->floor, round_off = epsilon*epsilon*moved;
    const NUMBER noise = ON(pick)(s->looked > 0, ON(larger)(round_off, floor/256), round_off);
    const NUMBER ratio = change/s->change, two_ago = s->before, of_two = change/two_ago;
    const NUMBER rate = ON(root)(of_two);
    const ON(mask) near = change < floor, far = ON(others)(near), met = ON(is_met)(s, defect);
    const ON(mask) stalls = near & ON(others)(change < s->least);
    s->before = s->change;
    s->change = change;
    s->least = ON(smaller)(change, s->least);
    s->sweeps += 1;
    s->turn = ON(pick)(s->turn < 7, s->turn + 1, ON(all)(0));
    const ON(mask) one = s->sweeps < 2, over = s->sweeps > (real)most;
    s->first = ON(pick)(one, change, s->first);
    if (watches)
        ON(watch)(s, change, ON(pick)(s->sweeps < 3, ratio, rate), rates);
    s->left = ON(what_is_left)(s, near, change, ratio, rate, rates);
    s->calm = ON(pick)(stalls, s->calm + 1, ON(all)(0));
    const ON(mask) small = (change <= tolerance*tolerance)
        | (met & ((65536*s->left < noise) | (s->calm > 3)));
    const ON(mask) bounded = change < 9, grows = (ratio > 1) & (of_two > 1);
    const ON(mask) late = far & ON(others)(one) & (s->turn < 1);
    const ON(mask) done = ON(pick_mask)(one, change <= 0, bounded & small);
    ON(mask) failed = ON(pick_mask)(one, ON(others)(change >= 0), ON(others)(bounded)
        | (s->sweeps > (real)most - 1) | (grows & far & (s->sweeps > 3)));
    if (ON(any)(late & ON(others)(failed)))
        failed |= late & ON(is_late)(s, most);
    const ON(verdict_t) verdict = { done | failed | over, over | (failed & ON(others)(done)) };
    return verdict;
}
