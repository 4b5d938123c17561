/* lambda.g_t: the power of a drive through the constraints, g_t between the two ends */
INLINE lanes RUN(drive_of_constraints)(const RUN(t) *w, const lanes *q_mean)
{
    lanes rate[M], sum = splat(0);
    lanes_mean_constraint_rate(&w->constants, q_mean, w->now.x, rate);
    for (int mu = 0; mu < M; ++mu)
        sum += w->h_inverse*w->now.x[RUN(IMPULSE) + mu]*rate[mu];
    return sum;
}
