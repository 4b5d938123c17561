/* The scaled unknowns of a lane from (B.2). */
static void RUN(load)(RUN(t) *w, int lane, const real x[U])
{
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a) {
            const int item = i/RUN(PER), place = item*N + a, at = lane + i % RUN(PER);
            const lanes *hb = &w->hb[item], *hb_hat = &w->hb_hat[item];
            set_part(&w->now.x[place], at, x[i*N + a]*part(hb, at));
            set_part(&w->now.x[RUN(HAT) + place], at, x[K_HAT + i*N + a]*part(hb_hat, at));
        }
    RUN(load_impulses)(w, lane, x + LAMBDA);
}
