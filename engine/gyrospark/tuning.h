/* Tuning constants of the predictor, the convergence test and the choice of the solver. */
#ifndef GS_TUNING_H
#define GS_TUNING_H

/*
 * No constant changes the limit of the iteration; they change its cost and its robustness.
 * *_UNITS are multiples of epsilon. Sizes of changes and defects are compared as squares.
 */

/* ------------------------------------------------------------------------------------ predictor */

#define UNDERFLOW_MARGIN 1024 /* times sqrt(MIN): the square of a smaller ridge would be denormal */
#define RIDGE_UNITS 8 /* a value of the history is rounded in a few operations */
#define STAGE_RIDGE_UNITS 4 /* the ridge of the least-squares predictor is relative to a norm */
#define OVERDETERMINATION 3 /* equations per coefficient; more cost time and add little accuracy */
#define DEFECT_ALLOWANCE 16 /* growth of the squared defect, for a shorter recurrence */
#define POOR_UNITS 16777216 /* 2^24: a prediction that is less accurate costs more iterations */
#define POLYNOMIAL_GAIN 4 /* ratio of squared errors at which a polynomial replaces a recurrence */
#define REFIT_FACTOR 16 /* the next fit follows after 16 times the steps so far, ... */
#define REFIT_GROWTH_END 4096 /* ... up to this number of steps, ... */
#define REFIT_INTERVAL 65536 /* ... and then at this interval */

#define CANDIDATE_GAIN 64 /* ratio of squared errors at which the candidate is selected */
#define ACCURATE_UNITS 256 /* a baseline with a smaller error is accurate enough and stays */
#define ERROR_FLOOR_UNITS 64 /* smaller prediction errors are round-off, and no reference */
#define DEGRADATION 4096 /* growth of the squared error that calls for another fit */
#define LATE_FIT 24 /* times HISTORY: one more fit, after initial transients have decayed */

#define INITIAL_RATE_STEPS 64 /* every step updates the contraction rates at first, ... */
#define RATE_STRIDE 8 /* ... and later every eighth: the update costs more than it gains */

/* ----------------------------------------------------------------------------- convergence test */

#define FLOOR_UNITS 16 /* round-off of one iteration, before it is estimated */
#define FLOOR_FACTOR 16 /* of the estimated round-off: the maximum exceeds the root mean square */
#define STALLED_RATIO 4 /* squared changes that shrink by less may be round-off */
#define DEFECT_PROGRESS ((real)0.8) /* ratio of squared defects that counts as progress */
#define DEFECT_FLOOR 4 /* times epsilon squared: (2 epsilon)^2, the rounding of g */
#define DEFECT_UNITS 4096 /* above it, a constraint defect that stagnates is not round-off */
#define CYCLE_END 7 /* the full test is made in every eighth iteration at least */
#define MAX_CHANGE 9 /* squared: a change of three times the state is divergence */
#define ROUND_OFF_MARGIN 16 /* a squared change this far above the floor shows a rate */
#define RATE_MEMORY 8 /* iterations that the running mean of a rate averages */
#define MIN_RATE ((real)0.0001) /* squared: a hundredth; few iterations do not show slow modes */
#define FLOOR_OVERESTIMATE 256 /* FLOOR_FACTOR squared: from the floor back to the round-off */
/*
 * 256 squared, of many stages 2^25: the remainder is systematic and adds up over steps. From six
 * stages on the predictor is so accurate that more costs half an iteration, and less costs energy:
 * 2^22 doubled its error after 1e7 steps of a fast top.
 */
#define REMAINDER_MARGIN (S > 5 ? 33554432 : 65536)
#define MAX_STAGNATION 3 /* iterations without progress near round-off */
#define MAX_DEFECT_STAGNATION 2 /* iterations without progress of the constraints */
#define SHORT_STEP_ITERATIONS 12 /* of h/4 and of h/2 together, for starts of the first step */

/* ------------------------------------------------------- iteration for tangents and adjoints */

#define DERIVATIVE_MARGIN 256 /* 16 squared: the remainder of a solution is below epsilon/16 */
#define SLOW_RATE ((real)0.09) /* 0.3 squared: a factorisation costs less than more iterations */
#define MOST_DERIVATIVE_ITERATIONS 40 /* at 0.3, of float128 */

/* ----------------------------------------------------- fixed-point iteration or Newton's method */

#define FAR_CHANGE ((real)0.02) /* first change above which another root is a risk */
#define EFFORT_MEMORY 8 /* steps that the running mean of the cost averages */
#define FITTED_TRIAL_STEPS 8 /* steps before methods are compared, where the predictor is fitted */
#define TRIAL_STEPS 80 /* the same before the fit: the predictor improves in these steps */
#define NEWTON_RESIDUALS 3 /* assumed residuals of a Newton step before one is measured */
#define SWITCH_RATIO ((real)1.5) /* of the costs: a smaller gain does not repay a change */
#define FIRST_RETRY 32 /* steps until the other method is tried again; the number doubles, ... */
#define MAX_RETRY (1 << 16) /* ... up to this one */
#define MAX_BACKOFF 6 /* after failures in a row, Newton takes 2^k - 1 steps, k up to this number */

#endif
