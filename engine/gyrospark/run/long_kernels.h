/* Long kernels, which are compiled in one object only. */
#ifndef GS_RUN_LONG_KERNELS_H
#define GS_RUN_LONG_KERNELS_H

#include "gyrospark/engine.h"

/*
 * Long kernels are compiled once. In a build of several objects (below) those of numbers are in
 * object 1, those of lanes in object 4, or in 3; what else calls them sees a declaration.
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
