/* The convergence test of the fixed-point iteration. */

#include "gyrospark/linear_algebra/norms.h"
#include "gyrospark/simd/vector.h"

/* ------------------------------------------------------------------- when a sweep has converged */

/* What is known of the sweeps of one step, in numbers alone. Changes and defects are squares. */
typedef struct {
    NUMBER iterations;
    NUMBER cycle;   /* the same modulo 8 */
    NUMBER stagnation;   /* sweeps near round-off that brought nothing more */
    NUMBER constraint_stagnation;   /* sweeps that brought the constraints no nearer */
    NUMBER estimated; /* 1 where the floor is what rounding was seen to be worth */
    NUMBER floor;  /* changes below it may be rounding: a size, no square */
    NUMBER change; /* of the last sweep: the sum of its squared increments relative to the state */
    NUMBER previous; /* of the sweep before it */
    NUMBER first;  /* of the first */
    NUMBER smallest;  /* of all sweeps */
    NUMBER remaining;   /* expected of the next sweep, were it not for rounding; far from that huge */
    NUMBER defect; /* of the constraints in the last sweep, relative to the state */
    NUMBER least_defect;
} TYPED(progress_t);

/* Where the sweeps have ended, and where they did without success. */
typedef struct {
    TYPED(mask) ended, failed;
} TYPED(convergence_t);

static TYPED(progress_t) TYPED(initial_progress)(void)
{
    const NUMBER none = TYPED(broadcast)(0), huge = TYPED(broadcast)((real)HUGE_VAL), floor = TYPED(broadcast)(16*epsilon);
    const TYPED(progress_t) start = { none, none, none, none, none, floor, none, none, none, huge,
        huge, huge, huge };
    return start;
}

/*
 * Where a change that hardly shrank, above the floor, calls for a look at what rounding is worth:
 * a stiff spring k rounds its force by epsilon k |q|, whatever the momentum.
 */
INLINE TYPED(mask) TYPED(needs_round_off_estimate)(const TYPED(progress_t) *s, NUMBER change)
{
    return (s->estimated < 1) & (s->iterations > 2) & (change > s->change/4)
        & TYPED(mask_not)(change < s->floor*s->floor);
}

/* `noise` is what stages some units in the last place away change in a sweep, squared. */
static void TYPED(set_round_off_floor)(TYPED(progress_t) *s, TYPED(mask) looks, NUMBER round_off)
{
    s->estimated = TYPED(select_value)(looks, TYPED(broadcast)(1), s->estimated);
    s->floor = TYPED(select_value)(looks, TYPED(larger)(s->floor, 16*TYPED(square_root)(round_off)), s->floor);
}

/* What constraints have come to. */
INLINE void TYPED(update_defect)(TYPED(progress_t) *s, NUMBER defect)
{
    s->constraint_stagnation = TYPED(select_value)(defect < (real)0.8*s->least_defect, TYPED(broadcast)(0), s->constraint_stagnation + 1);
    s->defect = defect;
    s->least_defect = TYPED(select_value)(defect < s->least_defect, defect, s->least_defect);
}

/*
 * A sweep far from rounding that shrank what it changes goes on whatever else is true of it, and
 * little is noted of it. Not so every eighth, nor one that calls for a look.
 */
INLINE TYPED(mask) TYPED(is_contracting)(const TYPED(progress_t) *s, NUMBER change, real tolerance, int max_iterations)
{
    return (change < s->change) & (s->iterations > 0) & (s->cycle < 7) & (s->iterations < (real)max_iterations - 2)
        & (change < 9) & (change > tolerance*tolerance) & TYPED(mask_not)(change < s->floor*s->floor)
        & TYPED(mask_not)(TYPED(needs_round_off_estimate)(s, change));
}

/* All that a verdict would note of it. */
INLINE void TYPED(update_contracting)(TYPED(progress_t) *s, NUMBER change, NUMBER defect)
{
    s->previous = s->change;
    s->change = change;
    s->smallest = TYPED(smaller)(change, s->smallest);
    s->iterations += 1;
    s->cycle += 1;
    s->stagnation = TYPED(broadcast)(0);
    s->remaining = TYPED(broadcast)((real)HUGE_VAL);
    TYPED(update_defect)(s, defect);
}

/* Whether the next sweep would leave no more of the constraints than rounding does, or cannot. */
INLINE TYPED(mask) TYPED(constraints_met)(TYPED(progress_t) *s, NUMBER defect)
{
    const real floor = 4*epsilon*epsilon;
    const real low = 4096*epsilon; /* above that, constraints that idle are not met */
    const TYPED(mask) next = (defect*defect <= floor*s->defect) & ((real)0.0001*defect <= floor);
    TYPED(update_defect)(s, defect);
    return (defect <= floor) | next | ((s->constraint_stagnation > 2) & (defect < low*low));
}

/* A rate that was never seen is that of the sweep before it, below 0; 1 where there is none. */
INLINE NUMBER TYPED(rate_magnitude)(NUMBER rate)
{
    return TYPED(larger)(rate, -rate);
}

/*
 * By how much this sweep shrinks a change, rates[0], is noted wherever a change that does so would
 * still be clear of rounding, whatever it then is: if large ones alone were, the mean would be too
 * large. Each sweep has its own: the first ones shrink less than those that follow.
 */
INLINE void TYPED(update_rates)(const TYPED(progress_t) *s, NUMBER change, NUMBER rate, NUMBER *rates)
{
    const NUMBER known = TYPED(rate_magnitude)(rates[0]);
    const TYPED(mask) old = (rates[0] > 0) & (rates[0] < 1), next = (rates[1] > 0) & (rates[1] < 1);
    const TYPED(mask) clear = (known >= 1) | (16*s->previous*known > s->floor*s->floor);
    const TYPED(mask) seen = (s->iterations > 1) & (rate < 1) & (change < 9) & clear;
    const NUMBER mean = TYPED(select_value)(old, rates[0] + (rate - rates[0])/8, rate);
    rates[0] = TYPED(select_value)(seen, mean, rates[0]);
    rates[1] = TYPED(select_value)(next, rates[1], -TYPED(rate_magnitude)(rates[0]));
}

/*
 * What is left after a sweep near rounding, where changes tell nothing any more: it goes on
 * shrinking as it is known to do, or as it did in this step where nothing is known.
 */
INLINE NUMBER TYPED(predict_remaining)(const TYPED(progress_t) *s, TYPED(mask) near, NUMBER change, NUMBER ratio,
    NUMBER rate, const NUMBER *rates)
{
    /* Few sweeps do not tell the slow modes: count on no less than a hundredth of the change. */
    const NUMBER slow = TYPED(broadcast)((real)0.0001);
    const NUMBER next = TYPED(larger)(ratio, TYPED(select_value)(s->iterations < 3, slow, rate));
    const NUMBER known = TYPED(rate_magnitude)(rates[1]);
    const NUMBER usual = TYPED(larger)(slow, TYPED(select_value)(known < 1, known, next));
    return TYPED(select_value)(near, TYPED(smaller)(s->remaining, change)*usual, TYPED(broadcast)((real)HUGE_VAL));
}

/* Where changes at the rate of all sweeps so far would not come to the floor in time. */
NOINLINE TYPED(mask) TYPED(is_too_slow)(const TYPED(progress_t) *s, int max_iterations)
{
    const NUMBER remaining = ((real)max_iterations - s->iterations)/(s->iterations - 1);
    const NUMBER last = s->change*TYPED(power)(s->change/s->first, remaining);
    return last > s->floor*s->floor;
}

/*
 * Ends the sweeps when what is left is far below what rounding is worth in a step that has `moved`
 * the state (squared and relative): it adds up from step to step, as it is not random. Or when
 * changes near round-off have stopped shrinking. Not while the constraints are still coming nearer.
 * They fail when changes grow, or would not get there in time. Each lane by itself: what it comes
 * to depends on no other.
 */
static TYPED(convergence_t) TYPED(test_convergence)(TYPED(progress_t) *s, NUMBER change, NUMBER defect, NUMBER step_squared,
    real tolerance, int max_iterations, int updates, NUMBER *rates)
{
    const NUMBER floor = s->floor*s->floor, least = epsilon*epsilon*step_squared;
    const NUMBER round_off = TYPED(select_value)(s->estimated > 0, TYPED(larger)(least, floor/256), least);
    const NUMBER ratio = change/s->change, two_ago = s->previous, of_two = change/two_ago;
    const NUMBER rate = TYPED(square_root)(of_two);
    const TYPED(mask) near = change < floor, far = TYPED(mask_not)(near), met = TYPED(constraints_met)(s, defect);
    const TYPED(mask) stalls = near & TYPED(mask_not)(change < s->smallest);
    s->previous = s->change;
    s->change = change;
    s->smallest = TYPED(smaller)(change, s->smallest);
    s->iterations += 1;
    s->cycle = TYPED(select_value)(s->cycle < 7, s->cycle + 1, TYPED(broadcast)(0));
    const TYPED(mask) one = s->iterations < 2, over = s->iterations > (real)max_iterations;
    s->first = TYPED(select_value)(one, change, s->first);
    if (updates)
        TYPED(update_rates)(s, change, TYPED(select_value)(s->iterations < 3, ratio, rate), rates);
    s->remaining = TYPED(predict_remaining)(s, near, change, ratio, rate, rates);
    s->stagnation = TYPED(select_value)(stalls, s->stagnation + 1, TYPED(broadcast)(0));
    const TYPED(mask) small = (change <= tolerance*tolerance)
        | (met & ((65536*s->remaining < round_off) | (s->stagnation > 3)));
    const TYPED(mask) bounded = change < 9, grows = (ratio > 1) & (of_two > 1);
    const TYPED(mask) too_slow = far & TYPED(mask_not)(one) & (s->cycle < 1);
    const TYPED(mask) done = TYPED(select_mask)(one, change <= 0, bounded & small);
    TYPED(mask) failed = TYPED(select_mask)(one, TYPED(mask_not)(change >= 0), TYPED(mask_not)(bounded)
        | (s->iterations > (real)max_iterations - 1) | (grows & far & (s->iterations > 3)));
    if (TYPED(any)(too_slow & TYPED(mask_not)(failed)))
        failed |= too_slow & TYPED(is_too_slow)(s, max_iterations);
    const TYPED(convergence_t) verdict = { done | failed | over, over | (failed & TYPED(mask_not)(done)) };
    return verdict;
}
