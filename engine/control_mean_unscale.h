/* The unknowns from those of the sweeps: a multiplier is an impulse by h. */
static void unscale(const state_t *w, real x[U])
{
    for (int e = 0; e < X; ++e)
        x[e] = w->x[e]/(e < IMPULSE ? 1 : w->h);
}
