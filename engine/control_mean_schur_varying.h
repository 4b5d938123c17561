/* W = G H_pp G^T at the end of the step, factorised */
static void begin_sweeps(state_t *w)
{
    real q[N], p[N];
    for (int a = 0; a < N; ++a) {
        q[a] = w->q[a] + w->x[a];
        p[a] = w->p[a] + w->x[HAT + a];
    }
    schur(&w->constants, q, p, w->factors[0]);
    factorise(w->factors[0]);
}

/* impulse += 2 (h W)^-1 g */
static void correct(state_t *w, real g[M], real impulse[M])
{
    substitute(w->factors[0], g);
    for (int mu = 0; mu < M; ++mu)
        impulse[mu] += 2*w->h_inverse*g[mu];
}
