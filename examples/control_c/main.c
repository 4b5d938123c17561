/*
 * Attitude control of a satellite by torques: a PD controller, sampled at 10 Hz, for 600 s.
 * No allocation and a bounded number of fixed-point iterations per step; runs on a microcontroller.
 *
 *   gyrospark generate --system satellite.toml --scheme G-L --stages 2 --real float --profile control --out .
 *   cc -std=c11 -O2 -ffp-contract=off main.c wheeled_satellite_gl2_gamma_float.c -lm -o satellite && ./satellite
 */
#include <math.h>
#include <stdio.h>

#define WHEELED_SATELLITE_GL2_GAMMA_FLOAT_WORK /* defines the work struct */
#include "wheeled_satellite_gl2_gamma_float.h"

#define SATELLITE(name) wheeled_satellite_gl2_gamma_float_##name

/* Torque of a wheel in N m: a PD law with saturation. */
static float torque(float error, float rate)
{
    const float wanted = -0.5f*error - 4.0f*rate, most = 0.2f;
    return fminf(fmaxf(wanted, -most), most);
}

int main(void)
{
    static SATELLITE(work) work;
    SATELLITE(parameters) satellite = { .I1 = 12, .I2 = 10, .I3 = 3, .gamma = 25.0f/3 };
    const SATELLITE(options) options = { .tolerance = 0, .max_iterations = 12 };
    const float spin[3] = { -0.004f, 0, -0.05f }; /* rad/s, body axes */
    float q[4] = { 0.5f, 0.5f, -0.5f, 0.5f }, p[4];
    SATELLITE(status) status = SATELLITE(start)(&satellite, q, spin, p);
    int most = 0;

    if (status == 0)
        status = SATELLITE(begin)(&work, &satellite, &options, 0.1f, q, p);
    for (int k = 0; k <= 6000 && status == 0; ++k) {
        const float t = 0;
        float omega[3]; /* gyroscope output */
        SATELLITE(quantities)(&satellite, &t, q, p, omega);
        if (k % 1000 == 0) {
            const float sine = sqrtf(q[1]*q[1] + q[2]*q[2] + q[3]*q[3]);
            const float angle = 2*atan2f(sine, fabsf(q[0]))*180/3.14159265f;
            printf("%4d s: %.1e degrees off, |omega| = %.1e rad/s\n", k/10, (double)angle,
                (double)sqrtf(omega[0]*omega[0] + omega[1]*omega[1] + omega[2]*omega[2]));
        }
        const float turn = q[0] < 0 ? -1 : 1; /* the smaller rotation */
        satellite.u1 = torque(turn*q[1], omega[0]);
        satellite.u2 = torque(turn*q[2], omega[1]);
        satellite.u3 = torque(turn*q[3], omega[2]);
        status = SATELLITE(set_parameters)(&work, &satellite);
        if (status == 0)
            status = SATELLITE(advance)(&work, q, p);
        if (status != 0) {
            printf("step %d: status %d, an iteration still changes %.1e\n", k, (int)status,
                (double)SATELLITE(change)(&work));
        }
        most = SATELLITE(iterations)(&work) > most ? SATELLITE(iterations)(&work) : most;
    }
    printf("at most %d iterations a step, %u bytes of memory\n", most,
        (unsigned)SATELLITE(work_size)());
    return (int)status;
}
