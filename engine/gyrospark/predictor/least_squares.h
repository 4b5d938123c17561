/* Least-squares problems of the predictor. */
#ifndef GS_PREDICTOR_LEAST_SQUARES_H
#define GS_PREDICTOR_LEAST_SQUARES_H

#include "gyrospark/predictor/recurrence.h"

/* Keeps the compiler from holding more values in registers than there are, and spilling them. */
#if defined(__GNUC__)
#define LOAD_AGAIN(pointer) __asm__("" : "+r"(pointer))
#else
#define LOAD_AGAIN(pointer) (void)(pointer)
#endif

/* -------------------------------------------------------- what the past of a motion says of it */

/*
 * The stages of a step are values of one motion at different times. Those of the next step are a
 * linear function of stages of the last one and of the first of each step before it, the same
 * function for all coordinates. L and L^ of a coordinate swing with the same frequencies: each
 * regards both, and learns of a motion in half as many steps. It is fitted to the steps in memory
 * by least squares; the ridge is their round-off, which keeps the coefficients small. One lesson
 * serves one trajectory.
 */
enum { SKIP = S > 4 ? 2 : 1, LAST = (S + SKIP - 1)/SKIP }; /* each SKIP-th stage, to the last */
enum { LAGS = 13, REGRESSORS = 2*(LAST + LAGS) };
enum { EQUATION_ROWS = 16 };
_Static_assert((int)REGRESSORS >= (int)ORDER, "the multipliers have lessons of their own");
enum { FIRST_FIT = HISTORY/4, SECOND_FIT = 3*HISTORY/4 }; /* after so many steps */
/* Columns stand in blocks, those of the right sides in blocks of their own. */
enum { RIGHT_BLOCKS = (2*S + LANES - 1)/LANES, BLOCKS = (REGRESSORS + LANES - 1)/LANES + RIGHT_BLOCKS };

typedef struct {
    int unknowns, rights, blocks; /* unknown coefficients; the first block of right sides, and all */
    int count;                 /* equations that wait in A */
    lanes R[REGRESSORS][BLOCKS]; /* triangular, and right sides */
    lanes A[EQUATION_ROWS][BLOCKS];
} least_squares_t;

/* The stage of the last step that is number j of those regarded. */
INLINE int regressor_stage(int j)
{
    return S - 1 - (LAST - 1 - j)*SKIP;
}

/* How many steps before the last there are equations for, after `steps` steps; -1: for none. */
static int max_lags(long steps)
{
    int lags = LAGS;
    while (lags >= 0 && (steps - 1 - lags)*N < 2*(LAST + lags))
        --lags;
    return lags;
}

/* Of `available` equations, how many places from one that is taken to the next. */
static int stride_of(int available, int unknowns)
{
    return available > 3*unknowns ? (available - 1)/(3*unknowns) + 1 : 1;
}

INLINE real *scalars_of(lanes *row)
{
    return (real *)row;
}

/* `sides` are right sides; ridge[k % 2] is that of coefficient k. */
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
 * Reflections put the equations in A into R, column by column. Columns before the one in turn, in
 * the same block, are void from then on.
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
            const lanes share = factor*(even + odd);
            l->R[k][block] -= first*share;
            for (int i = 0; i < EQUATION_ROWS; ++i)
                l->A[i][block] -= value[i]*share;
        }
    }
    l->count = 0;
}

/* The next equation, to be filled in; its right sides come from right_sides on. */
static real *next_equation(least_squares_t *l)
{
    if (l->count == EQUATION_ROWS)
        eliminate_equations(l);
    lanes *row = l->A[l->count++];
    row[l->rights - 1] = splat(0); /* there may be columns of no use */
    for (int block = l->rights; block < l->blocks; ++block)
        row[block] = splat(0);
    return scalars_of(row);
}

INLINE int right_side_start(const least_squares_t *l)
{
    return l->rights*LANES;
}

/* Coefficients in place of the right sides. */
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

/* Coefficient k for right side j. */
INLINE real coefficient_value(least_squares_t *l, int k, int j)
{
    return k < l->unknowns ? scalars_of(l->R[k])[right_side_start(l) + j] : 0;
}

#endif
