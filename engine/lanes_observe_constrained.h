/* Adds what is left of the constraints at the one trajectory's state to the record. */
static void ONE(observe_defects)(const ONE(t) *s, report_t *report)
{
    lanes f[M];
    real g_size = 0, f_size = 0;
    lanes_hidden_constraint(&s->constants, s->q, s->p, f);
    for (int mu = 0; mu < M; ++mu) {
        g_size = larger(MATH(fabs)(part(&s->bound.g_rounded[mu], 0)), g_size);
        f_size = larger(MATH(fabs)(part(&f[mu], 0)), f_size);
    }
    observe_defects(g_size, f_size, report);
}
