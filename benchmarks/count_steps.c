/*
 * N steps of a stepper, and nothing else that grows with N: what callgrind counts.
 *
 *   cc -DSTEPPER=heavy_top_gl3_gamma -DHEADER='"heavy_top_gl3_gamma.h"' count_steps.c ...
 *   valgrind --tool=callgrind ./a.out N
 */
#include <stdlib.h>

#include HEADER

#define PASTE(stepper, what) stepper##_##what
#define JOIN(stepper, what) PASTE(stepper, what)
#define NAME(what) JOIN(STEPPER, what)

#ifdef ALPHA
#define FREE .alpha
#else
#define FREE .gamma
#endif

int main(int count, char **arguments)
{
    const long steps = count > 1 ? strtol(arguments[1], NULL, 10) : 1;
    const double I1 = 0.002, I3 = 0.0008, spin = 125.66370614359172;
    const NAME(parameters) top = {
        .I1 = I1, .I2 = I1, .I3 = I3, .mgl = 9.81*0.04, FREE = (2*I1 + I3)/3 };
    const NAME(options) options = { .tolerance = 0, .max_iterations = 50 };

    /* cos and sin of 15 degrees: tilted by 30 about x, p = 2 L(q)^T J Omega */
    double q[4] = { 0.9659258262890683, 0.25881904510252074, 0, 0 };
    double p[4] = { 0, 0, -2*q[1]*I3*spin, 2*q[0]*I3*spin };
    NAME(work) *work = malloc(NAME(work_size)());
    NAME(report) report = { 0 };
    return NAME(integrate)(&top, &options, 1e-3, steps, steps, q, p, NULL, NULL, NULL, NULL,
                           &report, work);
}
