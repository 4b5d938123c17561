/* The convergence test of the fixed-point iteration. */

#include "gyrospark/linear_algebra/norms.h"
#include "gyrospark/simd/vector.h"
#include "gyrospark/tuning.h"

/* ----------------------------------------------------------------------------- convergence test */

/* Progress of the iteration in one step. Changes and defects are squares; `floor` is not. */
typedef struct {
    NUMBER iterations;
    NUMBER cycle;         /* iterations modulo 8 */
    NUMBER stagnation;    /* iterations near round-off whose change did not decrease */
    NUMBER constraint_stagnation; /* iterations whose constraint defect did not decrease */
    NUMBER estimated;     /* 1 where the floor is an estimate of the round-off */
    NUMBER floor;         /* changes below it may be round-off */
    NUMBER change;        /* last iteration: squared norm of the increment, relative to the state */
    NUMBER previous;      /* change of the iteration before it */
    NUMBER first;         /* change of the first iteration */
    NUMBER smallest;      /* smallest change of all iterations */
    NUMBER remaining;     /* expected change of the next iteration in exact arithmetic; huge above
                             the floor */
    NUMBER defect;        /* constraint defect of the last iteration, relative to the state */
    NUMBER least_defect;  /* smallest defect of all iterations */
} TYPED(progress_t);

/* Result of the convergence test: the iteration has ended; it has ended without convergence. */
typedef struct {
    TYPED(mask) ended, failed;
} TYPED(convergence_t);

/* Progress before the first iteration: no change is known. */
static TYPED(progress_t) TYPED(initial_progress)(void)
{
    const NUMBER zero = TYPED(broadcast)(0), huge = TYPED(broadcast)((real)HUGE_VAL),
        floor = TYPED(broadcast)(FLOOR_UNITS*epsilon);
    const TYPED(progress_t) start = { zero, zero, zero, zero, zero, floor, zero, zero, zero, huge,
        huge, huge, huge };
    return start;
}

/*
 * Mask of the lanes that need an estimate of the round-off: the change hardly decreases above the
 * floor. Example: the force of a stiff spring k has the round-off epsilon k |q|, which is large
 * relative to a small momentum.
 */
INLINE TYPED(mask) TYPED(needs_round_off_estimate)(const TYPED(progress_t) *s, NUMBER change)
{
    return (s->estimated < 1) & (s->iterations > 2) & (change > s->change/STALLED_RATIO)
        & TYPED(mask_not)(change < s->floor*s->floor);
}

/* `round_off`: squared change of an iteration when its stages are perturbed by 2 ulp. */
static void TYPED(set_round_off_floor)(TYPED(progress_t) *s, TYPED(mask) stalled, NUMBER round_off)
{
    s->estimated = TYPED(select_value)(stalled, TYPED(broadcast)(1), s->estimated);
    s->floor = TYPED(select_value)(stalled,
        TYPED(larger)(s->floor, FLOOR_FACTOR*TYPED(square_root)(round_off)), s->floor);
}

/* Updates the constraint defect and its stagnation count. */
INLINE void TYPED(update_defect)(TYPED(progress_t) *s, NUMBER defect)
{
    s->constraint_stagnation = TYPED(select_value)(defect < DEFECT_PROGRESS*s->least_defect,
        TYPED(broadcast)(0), s->constraint_stagnation + 1);
    s->defect = defect;
    s->least_defect = TYPED(select_value)(defect < s->least_defect, defect, s->least_defect);
}

/*
 * Mask of the lanes that need no full test: the change decreased and is far above round-off, so the
 * iteration continues in any case. Every eighth iteration and each one that needs an estimate of
 * the round-off is tested in full.
 */
INLINE TYPED(mask) TYPED(is_contracting)(const TYPED(progress_t) *s, NUMBER change, real tolerance,
    int max_iterations)
{
    return (change < s->change) & (s->iterations > 0) & (s->cycle < CYCLE_END)
        & (s->iterations < (real)max_iterations - 2) & (change < MAX_CHANGE)
        & (change > tolerance*tolerance) & TYPED(mask_not)(change < s->floor*s->floor)
        & TYPED(mask_not)(TYPED(needs_round_off_estimate)(s, change));
}

/* The same update of the progress as in test_convergence, for a contracting iteration. */
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

/* Mask: the constraint defect is at round-off now, is so after one iteration, or stagnates. */
INLINE TYPED(mask) TYPED(constraints_met)(TYPED(progress_t) *s, NUMBER defect)
{
    const real floor = DEFECT_FLOOR*epsilon*epsilon;
    const real low = DEFECT_UNITS*epsilon; /* a defect that stagnates above it is not round-off */
    const TYPED(mask) next = (defect*defect <= floor*s->defect) & (MIN_RATE*defect <= floor);
    TYPED(update_defect)(s, defect);
    return (defect <= floor) | next
        | ((s->constraint_stagnation > MAX_DEFECT_STAGNATION) & (defect < low*low));
}

/*
 * |rate|. A negative entry is a default copied from the preceding iteration, used until a rate has
 * been measured; 1 means unknown.
 */
INLINE NUMBER TYPED(rate_magnitude)(NUMBER rate)
{
    return TYPED(larger)(rate, -rate);
}

/*
 * rates[0] <- running mean of the contraction rate of this iteration. The rate is measured if the
 * expected change, previous*rates[0], exceeds round-off. The actual change is not used in this
 * condition: it would discard small rates and bias the mean upwards. A separate mean is stored for
 * each iteration number, because the first iterations contract less than later ones.
 */
INLINE void TYPED(update_rates)(const TYPED(progress_t) *s, NUMBER change, NUMBER rate,
    NUMBER *rates)
{
    const NUMBER known = TYPED(rate_magnitude)(rates[0]);
    const TYPED(mask) old = (rates[0] > 0) & (rates[0] < 1), next = (rates[1] > 0) & (rates[1] < 1);
    const TYPED(mask) clear = (known >= 1)
        | (ROUND_OFF_MARGIN*s->previous*known > s->floor*s->floor);
    const TYPED(mask) seen = (s->iterations > 1) & (rate < 1) & (change < MAX_CHANGE) & clear;
    const NUMBER mean = TYPED(select_value)(old, rates[0] + (rate - rates[0])/RATE_MEMORY,
        rate);
    rates[0] = TYPED(select_value)(seen, mean, rates[0]);
    rates[1] = TYPED(select_value)(next, rates[1], -TYPED(rate_magnitude)(rates[0]));
}

/*
 * remaining <- remaining*rate: the expected change of the next iteration. Near round-off, observed
 * changes carry no information; the rate is the mean of previous steps, or the rate of this step
 * where no mean is known.
 */
INLINE NUMBER TYPED(predict_remaining)(const TYPED(progress_t) *s, TYPED(mask) near, NUMBER change,
    NUMBER ratio, NUMBER rate, const NUMBER *rates)
{
    /*
     * The first iterations underestimate the rate, because slow modes are not yet dominant; hence a
     * lower bound.
     */
    const NUMBER slow = TYPED(broadcast)(MIN_RATE);
    const NUMBER next = TYPED(larger)(ratio, TYPED(select_value)(s->iterations < 3, slow, rate));
    const NUMBER known = TYPED(rate_magnitude)(rates[1]);
    const NUMBER usual = TYPED(larger)(slow, TYPED(select_value)(known < 1, known, next));
    return TYPED(select_value)(near, TYPED(smaller)(s->remaining, change)*usual,
        TYPED(broadcast)((real)HUGE_VAL));
}

/* Mask: at the mean rate so far, the change stays above the floor until max_iterations. */
NOINLINE TYPED(mask) TYPED(is_too_slow)(const TYPED(progress_t) *s, int max_iterations)
{
    const NUMBER remaining = ((real)max_iterations - s->iterations)/(s->iterations - 1);
    const NUMBER last = s->change*TYPED(power)(s->change/s->first, remaining);
    return last > s->floor*s->floor;
}

/*
 * The convergence test. The iteration has converged when the expected remainder is far below the
 * round-off of the step; far below, because the remainder is systematic and accumulates over steps.
 * `step_squared` is the squared increment of the state in the step, relative to the state. The
 * iteration has also converged when changes near round-off stagnate. In both cases the constraints
 * must be met. The iteration fails when changes grow, or decrease too slowly for max_iterations.
 * The test of a lane does not depend on other lanes.
 */
static TYPED(convergence_t) TYPED(test_convergence)(TYPED(progress_t) *s, NUMBER change,
    NUMBER defect, NUMBER step_squared, real tolerance, int max_iterations, int updates,
    NUMBER *rates)
{
    const NUMBER floor = s->floor*s->floor, least = epsilon*epsilon*step_squared;
    const NUMBER round_off = TYPED(select_value)(s->estimated > 0,
        TYPED(larger)(least, floor/FLOOR_OVERESTIMATE), least);
    const NUMBER ratio = change/s->change, two_ago = s->previous, of_two = change/two_ago;
    const NUMBER rate = TYPED(square_root)(of_two);
    const TYPED(mask) near = change < floor, far = TYPED(mask_not)(near),
        met = TYPED(constraints_met)(s, defect);
    const TYPED(mask) stalls = near & TYPED(mask_not)(change < s->smallest);
    s->previous = s->change;
    s->change = change;
    s->smallest = TYPED(smaller)(change, s->smallest);
    s->iterations += 1;
    s->cycle = TYPED(select_value)(s->cycle < CYCLE_END, s->cycle + 1, TYPED(broadcast)(0));
    const TYPED(mask) one = s->iterations < 2, over = s->iterations > (real)max_iterations;
    s->first = TYPED(select_value)(one, change, s->first);
    if (updates)
        TYPED(update_rates)(s, change, TYPED(select_value)(s->iterations < 3, ratio, rate), rates);
    s->remaining = TYPED(predict_remaining)(s, near, change, ratio, rate, rates);
    s->stagnation = TYPED(select_value)(stalls, s->stagnation + 1, TYPED(broadcast)(0));
    const TYPED(mask) small = (change <= tolerance*tolerance)
        | (met & ((REMAINDER_MARGIN*s->remaining < round_off)
            | (s->stagnation > MAX_STAGNATION)));
    const TYPED(mask) bounded = change < MAX_CHANGE, grows = (ratio > 1) & (of_two > 1);
    const TYPED(mask) too_slow = far & TYPED(mask_not)(one) & (s->cycle < 1);
    const TYPED(mask) done = TYPED(select_mask)(one, change <= 0, bounded & small);
    TYPED(mask) failed = TYPED(select_mask)(one, TYPED(mask_not)(change >= 0),
        TYPED(mask_not)(bounded)
        | (s->iterations > (real)max_iterations - 1) | (grows & far & (s->iterations > 3)));
    if (TYPED(any)(too_slow & TYPED(mask_not)(failed)))
        failed |= too_slow & TYPED(is_too_slow)(s, max_iterations);
    const TYPED(convergence_t) result = { done | failed | over,
        over | (failed & TYPED(mask_not)(done)) };
    return result;
}
