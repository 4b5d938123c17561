/* The order of a recurrence of all multipliers that there are equations for. */
static int RUN(order_after)(long steps)
{
    int order = ORDER;
    while (order > 1 && (steps - order)*P*M < 2*order)
        --order;
    return order;
}

/* The recurrence of the multipliers of one trajectory, from equations of all nodes. */
static void RUN(learn_nodes)(RUN(t) *w, lesson_t *l, int track)
{
    const int steps = RUN(steps_recalled)(w), order = RUN(order_after)(steps);
    const int available = (steps - order)*P*M, stride = stride_of(available, order);
    const real ridge = RUN(ridge)(RUN(recalled)(w, 1) + RUN(IMPULSE), RUN(X) - RUN(IMPULSE), track);
    begin_lesson(l, order, 1, (const real[2]){ ridge, ridge });
    for (int e = 0; e < available; e += stride) {
        const int ago = 1 + e/(P*M), j = e/M % P, mu = e % M;
        real *row = next_row(l);
        for (int k = 0; k < order; ++k)
            row[k] = RUN(number)(RUN(recalled)(w, ago + 1 + k) + RUN(IMPULSE), track, j, M, mu);
        row[right_sides(l)] = RUN(number)(RUN(recalled)(w, ago) + RUN(IMPULSE), track, j, M, mu);
    }
    end_lesson(l);
    for (int k = 0; k < ORDER; ++k)
        RUN(set_track)(&w->lessons.wave[k], track, learnt(l, k, 0));
    w->lessons.order = order;
}

/* The multipliers of the next step by it. */
INLINE void RUN(nodes_ahead)(const RUN(t) *w, lanes *x)
{
    const RUN(lessons) *s = &w->lessons;
    const lanes *before[ORDER];
    for (int m = 0; m < s->order; ++m)
        before[m] = RUN(recalled)(w, 1 + m) + RUN(IMPULSE);
    for (int e = 0; e < RUN(X) - RUN(IMPULSE); ++e) {
        lanes even = splat(0), odd = splat(0);
        for (int m = 0; m + 1 < s->order; m += 2) {
            even += s->wave[m]*before[m][e];
            odd += s->wave[m + 1]*before[m + 1][e];
        }
        if (s->order % 2 == 1)
            even += s->wave[s->order - 1]*before[s->order - 1][e];
        x[e] = even + odd;
    }
}
