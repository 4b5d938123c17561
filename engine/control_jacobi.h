/* H_q is taken where H_p was. */
static void follow(const state_t *w, const real L[S*N], real Q[S*N])
{
    (void)w, (void)L, (void)Q;
}
