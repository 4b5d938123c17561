/* ---------------------------------------------------------------- starting values from the past */

/*
 * Backward differences of the unknowns, past[k], continue the polynomial through the last steps:
 * x_n = sum_(k < order) past[k]. What that has missed is the next difference of the new values.
 */
static void predict(state_t *w)
{
    for (int e = 0; e < X; ++e) {
        w->x[e] = 0;
        for (int k = w->order - 1; k >= 0; --k)
            w->x[e] += w->past[k][e];
    }
}

/* Records the unknowns of the step just done, and chooses the order for the next one. */
static void record(state_t *w)
{
    real *rest = w->x, best = (real)HUGE_VAL; /* the unknowns are not asked for any more */
    w->order = 1;
    for (int k = 0; k < ORDERS && k <= w->known; ++k) {
        real missed = 0;
        for (int e = 0; e < X; ++e) {
            const real old = w->past[k][e];
            w->past[k][e] = rest[e];
            rest[e] -= old;
            missed += e < HAT ? rest[e]*rest[e] : 0;
        }
        if (k < w->known && missed < best) {
            best = missed;
            w->order = k + 1;
        }
    }
    w->known += w->known < ORDERS;
}
