/* The multipliers of step k, each at the time of its node: where g turns, so do they. */
static void turn_multipliers_of(const frame_t *frame, real dt, long k, real *multipliers)
{
    for (int l = 0; l < MULTIPLIERS/M && frame->moves; ++l) {
        angles_t at;
        real x[M];
        angles_after(frame, dt, k - 1, node_of(l), &at);
        turn_multipliers(frame->parameters, at.cosine, at.sine, frame->axis, multipliers + l*M, x);
        for (int mu = 0; mu < M; ++mu)
            multipliers[l*M + mu] = x[mu];
    }
}
