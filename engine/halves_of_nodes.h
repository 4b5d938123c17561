/* D_l = sum_j nu_lj L_j */
NOINLINE void RUN(displace)(const RUN(t) *w, const lanes *L, lanes *D)
{
    RUN(halves)(P - 1, S, 0, 1, w->zero, 0, &half_nu[0][0], L, D);
}

/* C_i = p + sum_j nu~_ij Y_j */
NOINLINE void RUN(pulls)(const RUN(t) *w, const lanes *Y, lanes *C)
{
    RUN(halves)(S, P - 1, 1, 0, w->p, 0, &half_nu_tilde[0][0], Y, C);
}
