/* Vectors of lanes, their masks and elementary operations. */
#ifndef GS_SIMD_VECTOR_H
#define GS_SIMD_VECTOR_H

#include "gyrospark/engine.h"

#if GS_WIDE_REAL
/* ------------------------------------------------------------------------ vector type: one lane */

/* There are no vector registers for this type. */
typedef real lanes;
#else
/* ---------------------------------------------------------------------------------- vector type */

/*
 * One vector register where the compiler and the processor support it, else one scalar; both have
 * the same expressions. GYROSPARK_PLAIN selects scalars.
 */
#if defined(__GNUC__) && !defined(GYROSPARK_PLAIN)
#if defined(__AVX512F__)
#define LANE_BYTES 64
#elif defined(__AVX__)
#define LANE_BYTES 32
#else
#define LANE_BYTES 16
#endif
typedef real lanes __attribute__((vector_size(LANE_BYTES)));
#else
typedef real lanes;
#endif
#endif

enum { LANES = sizeof(lanes)/sizeof(real) };

/* unused: no stepper calls all functions, and clang warns about the rest. -O0: fast builds. */
#if defined(__OPTIMIZE__)
#define INLINE static inline __attribute__((always_inline, unused))
#elif defined(__GNUC__)
#define INLINE static inline __attribute__((unused))
#else
#define INLINE static inline
#endif
#if defined(__GNUC__)
#define NOINLINE static __attribute__((noinline))
#else
#define NOINLINE static
#endif
#if GS_LARGE
#define INLINE_IF_SMALL NOINLINE
#else
#define INLINE_IF_SMALL INLINE
#endif

/* x in every lane */
INLINE lanes splat(real x)
{
    return x - (lanes){ 0 };
}

/* Number i of a vector */
INLINE real lane_get(const lanes *x, int i)
{
    return ((const real *)x)[i];
}

INLINE void lane_set(lanes *x, int i, real value)
{
    ((real *)x)[i] = value;
}

/* x + y = *high + *low exactly, *high the rounded sum (Knuth). */
INLINE void two_sum(lanes x, lanes y, lanes *high, lanes *low)
{
    const lanes sum = x + y, share = sum - x;
    *low = (x - (sum - share)) + (y - share);
    *high = sum;
}

/* Masks: results of comparisons, of numbers and lane by lane. */
typedef int mask;

INLINE mask mask_not(mask m)
{
    return !m;
}

INLINE mask select_mask(mask m, mask x, mask y)
{
    return m ? x : y;
}

INLINE real select_value(mask m, real x, real y)
{
    return m ? x : y;
}

#if defined(LANE_BYTES)
typedef __typeof__((lanes){ 0 } < (lanes){ 0 }) lanes_mask; /* integers of equal width: 0 or -1 */

INLINE int mask_get(const lanes_mask *m, int i)
{
    return (*m)[i] != 0;
}

INLINE lanes_mask lanes_mask_not(lanes_mask m)
{
    return ~m;
}

INLINE lanes_mask lanes_select_mask(lanes_mask m, lanes_mask x, lanes_mask y)
{
    return (m & x) | (~m & y);
}

/* x where m is true, else y */
INLINE lanes lanes_select_value(lanes_mask m, lanes x, lanes y)
{
    return (lanes)lanes_select_mask(m, (lanes_mask)x, (lanes_mask)y);
}
#else
typedef mask lanes_mask;
#define lanes_mask_not mask_not
#define lanes_select_mask select_mask
#define lanes_select_value select_value

INLINE int mask_get(const lanes_mask *m, int i)
{
    (void)i;
    return *m;
}
#endif

INLINE int lanes_any(lanes_mask m)
{
    int is_any = 0;
    for (int i = 0; i < LANES; ++i)
        is_any |= mask_get(&m, i);
    return is_any;
}

/* to = from in the lanes of m */
INLINE void assign_lanes(lanes_mask m, int count, const lanes *from, lanes *to)
{
    for (int e = 0; e < count; ++e)
        to[e] = lanes_select_value(m, from[e], to[e]);
}

INLINE lanes lanes_larger(lanes a, lanes b)
{
    return lanes_select_value(a > b, a, b);
}

INLINE lanes lanes_smaller(lanes a, lanes b)
{
    return lanes_select_value(a < b, a, b);
}

/* |x| in every lane */
INLINE lanes lanes_size(lanes x)
{
    return lanes_larger(x, -x);
}

INLINE lanes lanes_square_root(lanes x)
{
    lanes result = x;
    for (int i = 0; i < LANES; ++i)
        lane_set(&result, i, MATH(sqrt)(lane_get(&x, i)));
    return result;
}

INLINE lanes lanes_power(lanes x, lanes y)
{
    lanes result = x;
    for (int i = 0; i < LANES; ++i)
        lane_set(&result, i, MATH(pow)(lane_get(&x, i), lane_get(&y, i)));
    return result;
}

#define lanes_broadcast splat

INLINE int any(mask m)
{
    return m;
}

INLINE real smaller(real a, real b)
{
    return a < b ? a : b;
}

INLINE real square_root(real x)
{
    return MATH(sqrt)(x);
}

INLINE real power(real x, real y)
{
    return MATH(pow)(x, y);
}

INLINE real broadcast(real x)
{
    return x;
}

#if GS_SPARK
/*
 * The value in a register: compilers take it as a memory operand of each multiply-add, and a core
 * executes as few vector loads as multiply-adds in a cycle.
 */
INLINE lanes lanes_in_register(lanes value)
{
#if !GS_WIDE_REAL
#if defined(__GNUC__) && defined(__AVX512F__) && !defined(GYROSPARK_PLAIN)
    __asm__("" : "+v"(value));
#endif
#endif
    return value;
}
#endif

#if GS_COMPENSATED_LANES
#if GS_WIDE_REAL
/* Prevents the contraction of a product and a sum into an fma: volatile. */
INLINE lanes lanes_rounded(lanes value)
{
    volatile lanes stored = value;
    return stored;
}
#else
/* Prevents the contraction of a product and a sum into an fma. */
INLINE lanes lanes_rounded(lanes value)
{
#if defined(__GNUC__) && defined(__AVX512F__)
    __asm__("" : "+v"(value));
    return value;
#elif defined(__GNUC__) && defined(__SSE2__)
    __asm__("" : "+x"(value));
    return value;
#elif defined(__GNUC__) && defined(__aarch64__)
    __asm__("" : "+w"(value));
    return value;
#else
    volatile lanes stored = value;
    return stored;
#endif
}
#endif

/* a b - product, exactly */
INLINE lanes product_error(lanes a, lanes b, lanes product)
{
    lanes error = product;
    for (int i = 0; i < LANES; ++i)
        lane_set(&error, i, MATH(fma)(lane_get(&a, i), lane_get(&b, i), -lane_get(&product, i)));
    return error;
}

/* sum += product of the factors, in double-word arithmetic (two-product, two-sum). */
INLINE void lanes_add_product(lanes sum[2], int count, const lanes *factors)
{
    lanes high = factors[0], low = splat(0);
    for (int i = 1; i < count; ++i) {
        const lanes product = lanes_rounded(high*factors[i]);
        low = low*factors[i] + product_error(high, factors[i], product);
        high = product;
    }
    const lanes total = sum[0] + high, share = total - sum[0];
    sum[1] += low + ((sum[0] - (total - share)) + (high - share));
    sum[0] = total;
}
#endif

#endif
