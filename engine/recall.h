/* How many trajectories differ. */
INLINE int RUN(tracks)(const RUN(t) *w)
{
    return RUN(PER) == 1 ? w->constants._used : 1;
}

INLINE int RUN(steps_recalled)(const RUN(t) *w)
{
    return w->predictor.count < HISTORY ? (int)w->predictor.count : HISTORY;
}

/* The values of m steps ago, m = 0 for the next. */
INLINE const lanes *RUN(recalled)(const RUN(t) *w, int m)
{
    return w->past + ((w->predictor.count + 1 - m) & (HISTORY - 1))*RUN(X);
}

/* Number a of stage j of a trajectory; of a node where `width` is M. */
INLINE real RUN(number)(const lanes *x, int track, int j, int width, int a)
{
    return part(&x[j/RUN(PER)*width + a], track + j % RUN(PER));
}

/* The same number in all lanes of a trajectory. */
INLINE void RUN(set_track)(lanes *x, int track, real value)
{
    for (int i = 0; i < RUN(PER); ++i)
        set_part(x, track + i, value);
}

INLINE real RUN(of_track)(const lanes *x, int track)
{
    real sum = part(x, track);
    for (int i = 1; i < RUN(PER); ++i)
        sum += part(x, track + i);
    return sum;
}

/* The ridge: round-off of the `count` items at x, of one trajectory. */
static real RUN(ridge)(const lanes *x, int count, int track)
{
    lanes square = splat(0);
    for (int e = 0; e < count; ++e)
        square += x[e]*x[e];
    return 4*epsilon*MATH(sqrt)(RUN(of_track)(&square, track)) + MATH(sqrt)(LIMIT(MIN))*1024;
}
