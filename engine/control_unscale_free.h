/* The unknowns (B.2) from the scaled ones. */
static void unscale(const state_t *w, real x[U])
{
    for (int e = 0; e < S*N; ++e) {
        x[e] = w->x[e]/(w->h*weights[e/N]);
        x[K_HAT + e] = w->x[HAT + e]/(w->h*weights_hat[e/N]);
    }
}
