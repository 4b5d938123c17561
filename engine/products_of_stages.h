/* Q_i = q + sum_j mu_ij L_j */
INLINE void RUN(places)(const RUN(t) *w, const lanes *L, lanes *Q)
{
    RUN(stages_of_stages)(w->q, 0, TABLE(mu), L, Q);
}

/* base_i + sum_j mu^_ij L^_j */
INLINE void RUN(pushes)(const RUN(t) *w, const lanes *base, int stride, const lanes *L_hat,
    lanes *momentum)
{
    (void)w;
    RUN(stages_of_stages)(base, stride, TABLE(mu_hat), L_hat, momentum);
}
