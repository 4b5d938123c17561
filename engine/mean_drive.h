/* lambda.g_t: the power of a drive through the constraints, g_t between the two ends */
static real drive_of_constraints(work_t *w, const real x[U])
{
    real rate[M], sum = 0;
    mean_constraint_rate(&w->constants, w->q_mean, x, rate);
    for (int mu = 0; mu < M; ++mu)
        sum += x[2*N + mu]*rate[mu];
    return sum;
}
