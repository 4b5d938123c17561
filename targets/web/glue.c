/*
 * What a page asks of a stepper of profile control beside its own functions: many steps a call, and
 * how well the constraints hold. Compiled once for each stepper, whose C file it includes:
 *     cc -std=c11 -DSTEPPER='"heavy_top_gl3_gamma.c"' -DSPARK=1 -DCONSTRAINTS=1 -c glue.c
 * CONSTRAINTS is their number; SPARK and SPLITTING say which scheme it is: neither of IMS and EMS.
 */
#include <math.h>
#include <stdint.h>

#ifdef __wasm__
/*
 * WebAssembly has no fused multiply-add, and that of libc takes 40 ns. Where c is -a b, rounded, the
 * result is the error of a product, which Dekker's products of halves give exactly: the same bits.
 */
static inline double fused(double a, double b, double c)
{
    const double product = a*b, size = fabs(product);
    if (size == 0)
        return a == 0 || b == 0 ? product + c : fma(a, b, c);
    if (c != -product || !(size > 0x1p-900 && size < 0x1p900 && fabs(a) < 0x1p900
                           && fabs(b) < 0x1p900))
        return fma(a, b, c);
    const double split = 0x1p27 + 1, a_high = split*a - (split*a - a), a_low = a - a_high;
    const double b_high = split*b - (split*b - b), b_low = b - b_high;
    return ((a_high*b_high - product) + a_high*b_low + a_low*b_high) + a_low*b_low;
}

static inline float fused_float(float a, float b, float c)
{
    return (double)c == -(double)(a*b) ? (float)((double)a*b + c) : fmaf(a, b, c);
}
#define fma(a, b, c) fused(a, b, c)
#define fmaf(a, b, c) fused_float(a, b, c)
#define ROUNDED(value) (value) /* nothing is contracted */
#endif

#include STEPPER
#if SPLITTING /* which iterates nothing: its steps converge or fail */
#define NOT_CONVERGED OK
#endif

/* Steps until one fails; returns the last status. done: completed steps, their iterations. */
int NAME(repeat)(state_t *w, real q[N], real p[N], int steps, real done[2])
{
    int status = 0, completed = 0;
    int64_t iterations = 0;
    while (completed < steps) {
        status = (int)NAME(advance)(w, q, p);
        if (status > 1) /* neither OK nor NOT_CONVERGED, which splittings do not know */
            break;
        ++completed;
#if !SPLITTING
        iterations += NAME(iterations)(w);
#endif
    }
    done[0] = (real)completed;
    done[1] = (real)iterations;
    return status;
}

static inline real largest_of(int count, const real *values, real largest)
{
    for (int i = 0; i < count; ++i)
        largest = MATH(fmax)(largest, MATH(fabs)(values[i]));
    return largest;
}

/* The largest |g(q)|, and |f(q, p)| of the conditions on momenta where the scheme has them. */
void NAME(defects)(state_t *w, const real q[N], const real p[N], real largest[2])
{
    largest[0] = largest[1] = 0;
#if SPLITTING /* its constraints are those of unit quaternions */
    (void)w;
    for (int b = 0; b < BODIES; ++b) {
        real g = -1, f = 0;
        for (int k = 0; k < 4; ++k) {
            g += q[body_q[b][k]]*q[body_q[b][k]];
            f += q[body_q[b][k]]*p[body_q[b][k]];
        }
        largest[0] = largest_of(1, &g, largest[0]);
        largest[1] = largest_of(1, &f, largest[1]);
    }
#elif CONSTRAINTS
    real values[CONSTRAINTS];
    KERNEL(constraint)(&w->constants, q, values);
    largest[0] = largest_of(CONSTRAINTS, values, 0);
#if SPARK
    KERNEL(hidden_constraint)(&w->constants, q, p, values);
    largest[1] = largest_of(CONSTRAINTS, values, 0);
#else
    (void)p;
#endif
#else
    (void)w, (void)q, (void)p;
#endif
}
