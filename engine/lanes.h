enum { LANES = sizeof(lanes)/sizeof(real) };

#if defined(__GNUC__)
#define INLINE static inline __attribute__((always_inline))
#define NOINLINE static __attribute__((noinline))
#else
#define INLINE static inline
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
