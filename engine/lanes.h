enum { LANES = sizeof(lanes)/sizeof(real) };

/* unused: no stepper calls all of them, and clang warns of the others. -O0 is for fast builds. */
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

INLINE lanes splat(real x)
{
    return x - (lanes){ 0 };
}

INLINE real part(const lanes *x, int i)
{
    return ((const real *)x)[i];
}

INLINE void set_part(lanes *x, int i, real value)
{
    ((real *)x)[i] = value;
}

/* x + y = *high + *low exactly; *high is the rounded sum. */
INLINE void two_sum(lanes x, lanes y, lanes *high, lanes *low)
{
    const lanes sum = x + y, share = sum - x;
    *low = (x - (sum - share)) + (y - share);
    *high = sum;
}

/* In which lanes something holds: what a comparison gives. */
#if defined(LANE_BYTES)
typedef __typeof__((lanes){ 0 } < (lanes){ 0 }) lanes_mask; /* whole numbers, as wide: 0 or -1 */

INLINE int holds(const lanes_mask *m, int i)
{
    return (*m)[i] != 0;
}

INLINE lanes_mask lanes_others(lanes_mask m)
{
    return ~m;
}

INLINE lanes_mask lanes_pick_mask(lanes_mask m, lanes_mask x, lanes_mask y)
{
    return (m & x) | (~m & y);
}

/* x where m holds, elsewhere y */
INLINE lanes lanes_pick(lanes_mask m, lanes x, lanes y)
{
    return (lanes)lanes_pick_mask(m, (lanes_mask)x, (lanes_mask)y);
}
#else
typedef int lanes_mask;

INLINE int holds(const lanes_mask *m, int i)
{
    (void)i;
    return *m;
}

INLINE lanes_mask lanes_others(lanes_mask m)
{
    return !m;
}

INLINE lanes_mask lanes_pick_mask(lanes_mask m, lanes_mask x, lanes_mask y)
{
    return m ? x : y;
}

INLINE lanes lanes_pick(lanes_mask m, lanes x, lanes y)
{
    return m ? x : y;
}
#endif

INLINE int lanes_any(lanes_mask m)
{
    int found = 0;
    for (int i = 0; i < LANES; ++i)
        found |= holds(&m, i);
    return found;
}

/* to = from in the lanes of m */
INLINE void renew(lanes_mask m, int count, const lanes *from, lanes *to)
{
    for (int e = 0; e < count; ++e)
        to[e] = lanes_pick(m, from[e], to[e]);
}

INLINE lanes lanes_larger(lanes a, lanes b)
{
    return lanes_pick(a > b, a, b);
}

INLINE lanes lanes_smaller(lanes a, lanes b)
{
    return lanes_pick(a < b, a, b);
}

INLINE lanes lanes_root(lanes x)
{
    lanes result = x;
    for (int i = 0; i < LANES; ++i)
        set_part(&result, i, MATH(sqrt)(part(&x, i)));
    return result;
}

INLINE lanes lanes_power(lanes x, lanes y)
{
    lanes result = x;
    for (int i = 0; i < LANES; ++i)
        set_part(&result, i, MATH(pow)(part(&x, i), part(&y, i)));
    return result;
}

INLINE lanes lanes_all(real x)
{
    return splat(x);
}
