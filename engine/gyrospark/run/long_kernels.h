/* Linkage of long kernels, which only one object file compiles. */
#ifndef GS_RUN_LONG_KERNELS_H
#define GS_RUN_LONG_KERNELS_H

#include "gyrospark/engine.h"

/*
 * Compiling long kernels takes most of the build time. In a build of several objects (objects.h),
 * object 1 contains the scalar kernels and object 4 or 3 the lane kernels; the other objects
 * declare them.
 */
#if defined(__GNUC__) && defined(GYROSPARK_OBJECT)
#define ONCE
#else
#define ONCE static
#endif
#if defined(__GNUC__) && defined(GYROSPARK_OBJECT) && GYROSPARK_OBJECT != 1
#define NUMBERS_ELSEWHERE 1
#else /* __GNUC__ */
#define NUMBERS_ELSEWHERE 0
#endif
#if defined(__GNUC__) && defined(GYROSPARK_OBJECT) && GYROSPARK_OBJECT == 2
#define LANES_ELSEWHERE 1
#else /* __GNUC__ */
#define LANES_ELSEWHERE 0
#endif
#if defined(__GNUC__) && defined(GYROSPARK_OBJECT) && GYROSPARK_OBJECT == 4
#define LANES_ONCE __attribute__((noinline))
#else /* __GNUC__ */
#define LANES_ONCE NOINLINE
#endif

#endif
