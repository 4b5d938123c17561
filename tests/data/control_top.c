/*
 * Steps of the heavy top of profile control, the bits of its states, and what they took:
 * the same program for this machine and for others. NAME, REAL and STEPS are defined on the command line.
 */
#include <stdio.h>
#include <string.h>

#define JOIN(a, b) a##_##b
#define CALL(name, function) JOIN(name, function)
#define TEXT(x) #x
#define FILE_OF(name) TEXT(name.h)
#include FILE_OF(NAME)

#if defined(__ARM_ARCH_7EM__)
/* SysTick of the Cortex-M4: counts down from 2^24 - 1 with the processor's clock. */
static volatile unsigned *const systick = (volatile unsigned *)0xE000E010;

static void start_clock(void)
{
    systick[1] = 0xFFFFFF;
    systick[2] = 0;
    systick[0] = 5;
}

static unsigned clock_now(void)
{
    return 0xFFFFFF - systick[2];
}
#else
static void start_clock(void)
{
}

static unsigned clock_now(void)
{
    return 0;
}
#endif

static CALL(NAME, work) work;

static void print(const REAL *x)
{
    unsigned char bytes[4*sizeof(REAL)];
    memcpy(bytes, x, sizeof bytes);
    for (unsigned i = 0; i < sizeof bytes; ++i)
        printf("%02x", bytes[i]);
    printf("\n");
}

int main(void)
{
    const CALL(NAME, parameters) top = { .I1 = (REAL)0.002, .I2 = (REAL)0.002, .I3 = (REAL)0.0008,
        .mgl = (REAL)0.3924, .gamma = (REAL)0.0016 };
    const CALL(NAME, options) options = { .tolerance = 0, .max_iterations = 20 };
    REAL q[4] = { 1, 0, 0, 0 }, p[4] = { 0, (REAL)0.02, 0, (REAL)0.2 };
    unsigned long sum = 0, iterations = 0;
    unsigned most = 0;

    start_clock();
    CALL(NAME, begin)(&work, &top, &options, (REAL)1e-3, q, p);
    for (int k = 1; k <= STEPS; ++k) {
        const unsigned start = clock_now();
        if (CALL(NAME, advance)(&work, q, p) != 0)
            printf("status\n");
        const unsigned taken = (clock_now() - start) & 0xFFFFFF;
        sum += taken;
        most = taken > most ? taken : most;
        iterations += (unsigned)CALL(NAME, iterations)(&work);
        if (k % 100 == 0) {
            print(q);
            print(p);
        }
    }
    printf("%lu iterations, %lu ticks, at most %u a step, %u bytes\n", iterations, sum, most,
        (unsigned)CALL(NAME, work_size)());
    return 0;
}
