/*
 * The fast top of the paper (80) without Python:
 *
 *   generate --scheme G-L --stages 3 --rep gamma --standalone --no-compile --out .
 *   cc -std=c11 -O2 -ffp-contract=off main.c heavy_top_gl3_gamma.c -lm -o top && ./top
 */
#include <math.h>
#include <stdio.h>

#define HEAVY_TOP_GL3_GAMMA_WORK /* defines the work struct */
#include "heavy_top_gl3_gamma.h"

int main(void)
{
    const double I1 = 0.002, I3 = 0.0008, spin = 40*3.14159265358979323846;
    const heavy_top_gl3_gamma_parameters top = {
        .I1 = I1, .I2 = I1, .I3 = I3, .mgl = 9.81*0.04, .gamma = (2*I1 + I3)/3 };
    const heavy_top_gl3_gamma_options options = { .tolerance = 0, .max_iterations = 50 };

    /* Tilted by 30 degrees about x, spinning about its own axis: p = 2 L(q)^T J Omega. */
    const double half = 3.14159265358979323846/12;
    double q[4] = { cos(half), sin(half), 0, 0 };
    double p[4] = { -2*q[3]*I3*spin, 2*q[2]*I3*spin, -2*q[1]*I3*spin, 2*q[0]*I3*spin };
    heavy_top_gl3_gamma_work work; /* all memory of a step */
    heavy_top_gl3_gamma_report report = { 0 };

    const int status = heavy_top_gl3_gamma_integrate(
        &top, &options, 1e-3, 2000, 1, q, p, NULL, NULL, NULL, NULL, &report, &work);
    printf("status %d after %ld steps\n", status, report.steps);
    printf("q = %.15f %.15f %.15f %.15f\n", q[0], q[1], q[2], q[3]);
    printf("largest energy error %.1e, constraint %.1e, momentum constraint %.1e\n",
           report.energy_error_max, report.constraint_max, report.hidden_max);
    return status;
}
