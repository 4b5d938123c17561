/* Least-squares problems of the predictor. */
#ifndef GS_PREDICTOR_LEAST_SQUARES_H
#define GS_PREDICTOR_LEAST_SQUARES_H

#include "gyrospark/predictor/recurrence.h"
#include "gyrospark/tuning.h"

/*
 * Makes the compiler read the values from memory again; keeping all of them in registers would
 * cause spills.
 */
#if defined(__GNUC__)
#define LOAD_AGAIN(pointer) __asm__("" : "+r"(pointer))
#else
#define LOAD_AGAIN(pointer) (void)(pointer)
#endif

/* ---------------------------------------------------------------------- least-squares predictor */

/*
 * Linear prediction of the stages. The stages of the next step are a linear function of stages of
 * the last step and of the first stage of each step before it, with six stages and more also of the
 * middle one of the latest four. The coefficients are the same for all coordinates, because these
 * have the same frequencies. L and L^ of a coordinate share them too, so both are regressors of
 * both; this halves the number of steps needed for a fit. The coefficients are fitted to the history
 * by least squares, separately for each trajectory. The Tikhonov parameter (ridge) is the round-off
 * level of the data, which keeps the coefficients small.
 */
enum { SKIP = S > 4 ? 2 : 1, LAST = (S + SKIP - 1)/SKIP }; /* every SKIP-th stage, up to the last */
enum { LAGS = S > 5 ? 15 : 13, DENSE_LAGS = S > 5 ? 4 : 0 };
enum { REGRESSORS = 2*(LAST + LAGS + DENSE_LAGS) };
enum { EQUATION_ROWS = 16 }; /* eliminated together, by Householder reflections */
_Static_assert((int)REGRESSORS >= (int)ORDER, "the workspace is too small for the multipliers");
enum { FIRST_FIT = HISTORY/4, SECOND_FIT = 3*HISTORY/4 }; /* numbers of steps */
/* Columns are stored in blocks of LANES; the right-hand sides begin a new block. */
enum { RIGHT_BLOCKS = (2*S + LANES - 1)/LANES,
    BLOCKS = (REGRESSORS + LANES - 1)/LANES + RIGHT_BLOCKS };

typedef struct {
    int unknowns, rights, blocks; /* coefficients; first block of right-hand sides; all blocks */
    int count; /* equations in A, not yet eliminated */
    lanes R[REGRESSORS][BLOCKS]; /* triangular factor, right-hand sides */
    lanes A[EQUATION_ROWS][BLOCKS];
} least_squares_t;

/* Stage of the last step that is regressor j. */
INLINE int regressor_stage(int j)
{
    return S - 1 - (LAST - 1 - j)*SKIP;
}

/* Regressors of L, and as many of L^, with this number of lags. */
INLINE int regressors_of(int lags)
{
    return LAST + lags + (lags < DENSE_LAGS ? lags : DENSE_LAGS);
}

/* Number of regressors of lag m: its first stage, and the middle one if the lag is dense. */
INLINE int stages_of_lag(int m)
{
    return m > DENSE_LAGS ? 1 : 2;
}

/* Largest number of lags with enough equations after `steps` steps; -1 if there are too few. */
static int max_lags(long steps)
{
    int lags = LAGS;
    while (lags >= 0 && (steps - 1 - lags)*MEASURED < 2*regressors_of(lags))
        --lags;
    return lags;
}

/* Stride through the `available` equations: OVERDETERMINATION equations per coefficient. */
static int stride_of(int available, int unknowns)
{
    return available > OVERDETERMINATION*unknowns
        ? (available - 1)/(OVERDETERMINATION*unknowns) + 1 : 1;
}

/* The numbers of a row of lanes */
INLINE real *scalars_of(lanes *row)
{
    return (real *)row;
}

/* R = ridge, with ridge[k % 2] for coefficient k; `sides` right-hand sides. */
static void begin_least_squares(least_squares_t *l, int unknowns, int sides, const real ridge[2])
{
    l->unknowns = unknowns;
    l->rights = (unknowns + LANES - 1)/LANES;
    l->blocks = l->rights + (sides + LANES - 1)/LANES;
    l->count = 0;
    for (int k = 0; k < unknowns; ++k) {
        for (int block = 0; block < l->blocks; ++block)
            l->R[k][block] = splat(0);
        scalars_of(l->R[k])[k] = ridge[k % 2];
    }
}

/*
 * R <- triangular factor of (R; A), by Householder reflections. The update is by whole blocks: step
 * k also overwrites columns < k of its block, which are not needed any more.
 */
static void eliminate_equations(least_squares_t *l)
{
    const int blocks = l->blocks;
    for (; l->count < EQUATION_ROWS; ++l->count)
        for (int block = 0; block < blocks; ++block)
            l->A[l->count][block] = splat(0);
    for (int k = 0; k < l->unknowns; ++k) {
        lanes value[EQUATION_ROWS];
        real squares[4] = { 0 };
        for (int i = 0; i < EQUATION_ROWS; ++i) {
            const real number = scalars_of(l->A[i])[k];
            value[i] = splat(number);
            squares[i % 4] += number*number;
        }
        const real diagonal = scalars_of(l->R[k])[k];
        const real rest = (squares[0] + squares[1]) + (squares[2] + squares[3]);
        const real length = MATH(sqrt)(diagonal*diagonal + rest);
        const real first = diagonal < 0 ? diagonal - length : diagonal + length;
        const real factor = 1/(length*(first < 0 ? -first : first)); /* 2/|v|^2 */
        for (int block = k/LANES; block < blocks; ++block) {
            lanes even = first*l->R[k][block], odd = splat(0);
            for (int i = 0; i < EQUATION_ROWS; i += 2) {
                even += value[i]*l->A[i][block];
                odd += value[i + 1]*l->A[i + 1][block];
            }
            const lanes projection = factor*(even + odd);
            l->R[k][block] -= first*projection;
            for (int i = 0; i < EQUATION_ROWS; ++i)
                l->A[i][block] -= value[i]*projection;
        }
    }
    l->count = 0;
}

/* Row of the next equation; its right-hand sides begin at right_side_start. */
static real *next_equation(least_squares_t *l)
{
    if (l->count == EQUATION_ROWS)
        eliminate_equations(l);
    lanes *row = l->A[l->count++];
    row[l->rights - 1] = splat(0); /* the block may have padding columns */
    for (int block = l->rights; block < l->blocks; ++block)
        row[block] = splat(0);
    return scalars_of(row);
}

/* Place of the first right-hand side in a row */
INLINE int right_side_start(const least_squares_t *l)
{
    return l->rights*LANES;
}

/* Back substitution: the coefficients replace the right-hand sides. */
static void solve_least_squares(least_squares_t *l)
{
    eliminate_equations(l);
    for (int k = l->unknowns - 1; k >= 0; --k) {
        const real *row = scalars_of(l->R[k]);
        for (int block = l->rights; block < l->blocks; ++block) {
            lanes even = l->R[k][block], odd = splat(0);
            int j = k + 1;
            for (; j + 1 < l->unknowns; j += 2) {
                even -= row[j]*l->R[j][block];
                odd -= row[j + 1]*l->R[j + 1][block];
            }
            if (j < l->unknowns)
                even -= row[j]*l->R[j][block];
            l->R[k][block] = (even + odd)/row[k];
        }
    }
}

/* Coefficient k of right-hand side j. */
INLINE real coefficient_value(least_squares_t *l, int k, int j)
{
    return k < l->unknowns ? scalars_of(l->R[k])[right_side_start(l) + j] : 0;
}

#endif
