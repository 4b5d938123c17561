/* The state of a run becomes (q, p); where that is new, nothing is left over of rounding. */
static void take_over(work_t *w, const real q[N], const real p[N])
{
    ONE(t) *s = &fast_of(w)->run;
    for (int a = 0; a < N; ++a) {
        if (!(part(&s->q[a], 0) == q[a])) {
            s->q[a] = splat(q[a]);
            s->q_low[a] = splat(0);
        }
        if (!(part(&s->p[a], 0) == p[a])) {
            s->p[a] = splat(p[a]);
            s->p_low[a] = splat(0);
        }
    }
    for (int i = 0; i < LANES; ++i)
        ONE(prepare)(s, i, &w->constants, w->held.dt);
    TURNED(ONE(wake)(s));
    ONE(set_schur)(s);
    TIMED(lanes_at_time(&s->constants, splat(w->t));)
    ONE(look)(s);
}

/* After a step that failed: what it left behind is forgotten. */
static void recover(work_t *w)
{
    ONE(t) *s = &fast_of(w)->run;
    ONE(forget)(s);
    s->work = splat(work_so_far(&w->held.report));
    s->work_low = splat(0);
}
