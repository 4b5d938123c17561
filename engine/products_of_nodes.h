/* D_l = sum_j nu_lj L_j */
INLINE void RUN(displace)(const RUN(t) *w, const lanes *L, lanes *D)
{
    RUN(nodes_of_stages)(w->zero, 0, TABLE(nu), L, D);
}

/* C_i = p + sum_j nu~_ij Y_j */
INLINE void RUN(pulls)(const RUN(t) *w, const lanes *Y, lanes *C)
{
    RUN(stages_of_nodes)(w->p, 0, TABLE(nu_tilde), Y, C);
}
