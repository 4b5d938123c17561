/* Products of matrices with directions and cotangents, on numbers or lanes; the place of the time. */

/* y <- y + A x */
static inline void TYPED(add_times)(int rows, int columns, const NUMBER *A, const NUMBER *x,
    NUMBER *y)
{
    for (int a = 0; a < rows; ++a) {
        NUMBER sum = y[a];
        for (int b = 0; b < columns; ++b)
            sum += A[a*columns + b]*x[b];
        y[a] = sum;
    }
}

/* y <- y + A^T x */
static inline void TYPED(add_transposed)(int rows, int columns, const NUMBER *A, const NUMBER *x,
    NUMBER *y)
{
    for (int a = 0; a < rows; ++a)
        for (int b = 0; b < columns; ++b)
            y[b] += A[a*columns + b]*x[a];
}

/*
 * The direction of the constants, with that of the time at `share` of the step; the derivatives of
 * a mean value have one more column, by the step between both ends.
 */
static inline void TYPED(set_time_direction)(const NUMBER *dz, NUMBER share, NUMBER dc[E])
{
    for (int e = 0; e < E; ++e)
        dc[e] = dz[2*N + e];
#if TIMES
    dc[E - TIMES] = dz[DT0] + share*dz[DH];
#if TIMES > 1
    dc[E - 1] = dz[DH];
#endif
#else
    (void)share;
#endif
}

/* Adds a cotangent of the constants, with that of the time, to z. */
static inline void TYPED(add_time_cotangent)(const NUMBER c[E], NUMBER share, NUMBER *z)
{
    for (int e = 0; e < E - TIMES; ++e)
        z[2*N + e] += c[e];
#if TIMES
    z[DT0] += c[E - TIMES];
    z[DH] += share*c[E - TIMES];
#if TIMES > 1
    z[DH] += c[E - 1];
#endif
#else
    (void)share;
#endif
}
