/* Compilation as one object file or as several. */
#ifndef GS_RUN_OBJECTS_H
#define GS_RUN_OBJECTS_H

#include "gyrospark/newton/simplified.h"
#include "gyrospark/newton/step.h"

/*
 * A parallel build compiles the generated file several times and links the objects.
 * GYROSPARK_OBJECT selects the contents: 1, Newton's method and the functions without iteration; 2,
 * runs of one trajectory; 3, runs of batches, in which a single trajectory uses Newton's method; 4,
 * functions that object 2 calls outside of its fixed-point iteration; 5, the functions without
 * iteration alone, where object 1 is a library that is compiled later. Objects 2 to 4 call object 1
 * through:
 */
#if defined(__GNUC__) && defined(GYROSPARK_OBJECT)
int NAME(object_newton)(work_t *w, const options_t *options, real dt, const real *q, const real *p,
    real *x, int *iterations);
int NAME(object_simplified_newton)(work_t *w, const options_t *options, real dt, const real *q,
    const real *p, real *x, int *iterations);
int NAME(object_advance)(work_t *w, const options_t *options, real dt, const real *q, const real *p,
    real *q1, real *p1, real *multipliers, int *iterations);

#if GYROSPARK_OBJECT == 1 /* __GNUC__ */
int NAME(object_newton)(work_t *w, const options_t *options, real dt, const real *q, const real *p,
    real *x, int *iterations)
{
    return newton(w, options, dt, q, p, x, iterations);
}

int NAME(object_simplified_newton)(work_t *w, const options_t *options, real dt, const real *q,
    const real *p, real *x, int *iterations)
{
    return simplified_newton(w, options, dt, q, p, x, iterations);
}

int NAME(object_advance)(work_t *w, const options_t *options, real dt, const real *q, const real *p,
    real *q1, real *p1, real *multipliers, int *iterations)
{
    return advance(w, options, dt, q, p, q1, p1, multipliers, iterations);
}
#else /* __GNUC__ */
#define newton(...) NAME(object_newton)(__VA_ARGS__)
#define simplified_newton(...) NAME(object_simplified_newton)(__VA_ARGS__)
#define advance(...) NAME(object_advance)(__VA_ARGS__)
#endif
#endif

#if defined(__GNUC__) && defined(GYROSPARK_OBJECT) && GYROSPARK_OBJECT == 3
#define BY_NEWTON(options) ((void)(options), 1)
#else
#define BY_NEWTON(options) ((options)->solver == NEWTON)
#endif

#endif
