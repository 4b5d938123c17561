/* -------------------------------------------------------------- lanes: reals that move together */

/*
 * One vector register where compiler and machine have them, one number elsewhere: the same
 * expressions serve both. The build chooses; GYROSPARK_PLAIN asks for plain numbers.
 */
#if defined(__GNUC__) && !defined(GYROSPARK_PLAIN)
#if defined(__AVX512F__)
#define LANE_BYTES 64
#elif defined(__AVX__)
#define LANE_BYTES 32
#else
#define LANE_BYTES 16
#endif
typedef real lanes __attribute__((vector_size(LANE_BYTES)));
#else
typedef real lanes;
#endif
