/* The unknowns (B.2) from the scaled ones. */
static void RUN(unscale)(const RUN(t) *w, real x[U])
{
    real multipliers[ROOM];
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a) {
            const int item = i/RUN(PER), place = item*N + a, at = i % RUN(PER);
            const lanes *hb = &w->hb[item], *hb_hat = &w->hb_hat[item];
            x[i*N + a] = part(&w->now.x[place], at)/part(hb, at);
            x[K_HAT + i*N + a] = part(&w->now.x[RUN(HAT) + place], at)/part(hb_hat, at);
        }
    RUN(multipliers)(w, 0, multipliers);
    for (int l = 0; l < P*M; ++l)
        x[LAMBDA + l] = multipliers[l];
}
