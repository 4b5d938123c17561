/*
 * A top in a user-written loop, which prints the state every tenth of a second. The final state is
 * compared with one run of the same number of steps. "./top newton" uses Newton's method only.
 *
 *   generate --scheme G-L --stages 3 --rep gamma --profile run --out .
 *   cc -std=c11 -O2 -ffp-contract=off main.c heavy_top_gl3_gamma.c -lm -o top && ./top
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#define HEAVY_TOP_GL3_GAMMA_WORK /* defines the work struct */
#include "heavy_top_gl3_gamma.h"

#define TOP(name) heavy_top_gl3_gamma_##name

int main(int count, char **arguments)
{
    const double I1 = 0.002, I3 = 0.0008, spin = 40*3.14159265358979323846;
    const TOP(parameters) top = {
        .I1 = I1, .I2 = I1, .I3 = I3, .mgl = 9.81*0.04, .gamma = (2*I1 + I3)/3 };
    const int newton = count > 1 && strcmp(arguments[1], "newton") == 0;
    const TOP(options) options = { .tolerance = 0, .max_iterations = 50,
        .solver = newton ? HEAVY_TOP_GL3_GAMMA_NEWTON : HEAVY_TOP_GL3_GAMMA_AUTO };
    static TOP(work) work;

    /* Tilted by 30 degrees about x, spinning about its own axis: p = 2 L(q)^T J Omega. */
    const double half = 3.14159265358979323846/12;
    const double q0[4] = { cos(half), sin(half), 0, 0 };
    const double p0[4] = { -2*q0[3]*I3*spin, 2*q0[2]*I3*spin, -2*q0[1]*I3*spin, 2*q0[0]*I3*spin };
    double q[4], p[4], q_run[4], p_run[4];
    int status = 0;
    memcpy(q, q0, sizeof q);
    memcpy(p, p0, sizeof p);

    TOP(begin)(&work, &top, &options, 1e-3, q, p);
    for (int k = 0; k <= 20 && status == 0; ++k) {
        printf("%.1f s: q = %a %a %a %a, p = %a %a %a %a\n", k/10.0, q[0], q[1], q[2], q[3], p[0],
            p[1], p[2], p[3]);
        status = TOP(advance)(&work, 100, q, p);
    }
    const TOP(report) *report = TOP(report_of)(&work);
    printf("status %d after %ld steps, %ld by Newton; largest energy error %.1e, constraint %.1e\n",
        status, report->steps, report->newton_steps, report->energy_error_max,
        report->constraint_max);

    TOP(report) of_run = { 0 };
    memcpy(q_run, q0, sizeof q_run);
    memcpy(p_run, p0, sizeof p_run);
    TOP(integrate)(&top, &options, 1e-3, report->steps, 1, q_run, p_run, NULL, NULL, NULL,
        &of_run, &(TOP(work)){ 0 });
    const int same = memcmp(q, q_run, sizeof q) == 0 && memcmp(p, p_run, sizeof p) == 0;
    printf("one run of %ld steps ends %s\n", of_run.steps, same ? "at the same bits" : "elsewhere");
    return status != 0 || !same;
}
