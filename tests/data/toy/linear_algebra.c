/* The headers of linear_algebra/ with small matrices of their own, for tests. */
#include <float.h>
#include <math.h>
#include <stddef.h>

#define GS_ENGINE 1
#define GS_CONSTRAINED 1
#define NAME(function) toy_##function
#define MATH(function) function
#define LIMIT(name) DBL_##name
typedef double real;
typedef struct { int none; } toy_parameters, toy_constants, toy_options, toy_report, toy_work;
#include "gyrospark/engine.h"

enum { N = 3, U = 5, BAND = 2, M = 3, FACTOR = 5, LARGEST_CELL = 3 };
/* Unknowns 0..4 have these places in the band. */
static const int position[U] = { 2, 0, 4, 1, 3 };
/* W couples 0-1 and 1-2: entries W00, W11, W22, W10, W21. */
static const int pivot_order[M] = { 0, 1, 2 }, pivot_rows[M] = { 1, 1, 0 };
static const int below_row[2] = { 1, 2 }, below_target[1] = { 0 };
static const int before_rows[M] = { 0, 1, 1 }, before_row[2] = { 0, 1 }, before_slot[2] = { 3, 4 };
/* So does the mass matrix. */
static const int mass_order[N] = { 0, 1, 2 }, mass_rows[N] = { 1, 1, 0 };
static const int mass_row[2] = { 1, 2 }, mass_slot[2] = { 3, 4 }, mass_target[1] = { 0 };
static real mass_entry[5];
enum { MASS_ENTRIES = 5, MASS = MASS_ENTRIES + 2*N*N };

#include "gyrospark/linear_algebra/band_lu.h"
#include "gyrospark/linear_algebra/dense_lu.h"
#include "gyrospark/simd/vector.h"

typedef toy_constants lanes_constants, indefinite_constants;

#include "gyrospark/simd/numbers.h"
#include "gyrospark/linear_algebra/block_elimination.h"

static void mass_matrix(const constants *c, const real *q, real *A)
{
    (void)c, (void)q;
    for (int e = 0; e < MASS_ENTRIES; ++e)
        A[e] = mass_entry[e];
}

static void rest_momentum(const constants *c, const real *q, real *b)
{
    (void)c;
    for (int a = 0; a < N; ++a)
        b[a] = q[a];
}
#include "gyrospark/linear_algebra/mass_matrix.h"

#include "gyrospark/simd/lanes.h"
#include "gyrospark/linear_algebra/block_elimination.h"

/* An indefinite matrix, under names of its own. */
#undef TYPED
#undef NUMBER
#undef GS_INDEFINITE_MASS
#define GS_INDEFINITE_MASS 1
#define TYPED(f) indefinite_##f
#define NUMBER real
#define indefinite_mass_matrix mass_matrix
#define indefinite_rest_momentum rest_momentum
#include "gyrospark/linear_algebra/mass_matrix.h"

typedef double wide_real;
#define WIDE_MATH(function) function
static const wide_real quarter[3] = { QUARTER };
#include "gyrospark/linear_algebra/double_word.h"

int solve_dense(int n, double *A, double *b);
int solve_band(const double *A, double *b);
void eliminate(double *W, double *b);
void eliminate_lanes(double *W, double *b);
void invert_mass(int indefinite, const double *m, const double *b, const double *p, double *v);
void angle(long k, double dt, double rate, double out[2]);
double length_rest(double x, double y, double z);

int solve_dense(int n, double *A, double *b)
{
    int exponents[8], pivots[8];
    return solve(n, A, b, exponents, pivots);
}

int solve_band(const double *A, double *b)
{
    real J[U*WIDTH] = { 0 }, forward[U], dense[U*U];
    int rows[U], pivots[3*U];
    long products;
    for (int i = 0; i < U; ++i)
        for (int j = 0; j < U; ++j)
            if (A[i*U + j] != 0)
                *entry(J, i, j) = A[i*U + j];
    band_spread(J, dense);
    for (int e = 0; e < U*U; ++e)
        if (dense[e] != A[e])
            return -1;
    const int status = band_factorise(U, BAND, J, pivots, forward, rows, &products);
    return status == OK ? band_solve(J, pivots, b, forward) : status;
}

void eliminate(double *W, double *b)
{
    factor(W);
    substitute(W, b);
}

void eliminate_lanes(double *W, double *b)
{
    lanes A[FACTOR], x[M];
    for (int e = 0; e < FACTOR; ++e)
        A[e] = splat(W[e]);
    for (int mu = 0; mu < M; ++mu)
        x[mu] = splat(b[mu]);
    lanes_factor(A);
    lanes_substitute(A, x);
    for (int mu = 0; mu < M; ++mu)
        b[mu] = lane_get(&x[mu], LANES - 1);
}

/* v with M v = p - b */
void invert_mass(int indefinite, const double *m, const double *b, const double *p, double *v)
{
    const constants c = { 0 };
    real A[MASS];
    for (int e = 0; e < MASS_ENTRIES; ++e)
        mass_entry[e] = m[e];
    if (indefinite) {
        indefinite_factor_mass(&c, b, A);
        indefinite_velocities(&c, b, p, A, v);
    } else {
        factor_mass(&c, b, A);
        velocities(&c, b, p, A, v);
    }
}

void angle(long k, double dt, double rate, double out[2])
{
    const double_word t = plus(product_of((double)k, dt), product_of(0.5, 0));
    cos_sin(times(t, product_of(0.5, rate)), &out[0], &out[1]);
}

double length_rest(double x, double y, double z)
{
    const double_word length = length_of(x, y, z);
    return length.low/length.high;
}
