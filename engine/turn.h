/* ------------------------------------------------------------------ back from a co-moving frame */

/*
 * What is integrated is q~, p~ of H~ = H - sum omega_i J_i; q = e^(omega t A) q~ and
 * p = e^(-omega t A^T) p~, t since the start of the run. Angles are k dt omega, counted, not
 * summed up, in twice the digits: a run of any length loses none by turning.
 */
typedef struct {
    const parameters_t *parameters;
    twofold rate[ANGLES];
    real axis[AXES]; /* of rotations about any axis of space */
    int moves;
} frame_t;

/* cos and sin of every angle. */
typedef struct {
    real cosine[ANGLES], sine[ANGLES];
} angles_t;

static frame_t frame_of(const parameters_t *parameters)
{
    frame_t frame = { .parameters = parameters };
    frame_rates(parameters, frame.rate, frame.axis);
    for (int i = 0; i < ANGLES; ++i)
        frame.moves |= !(MATH(fabs)(frame.rate[i].high) <= 0);
    return frame;
}

/* The angles after k + share steps. */
static void angles_after(const frame_t *frame, real dt, long k, real share, angles_t *at)
{
    const twofold t = plus(product_of((turning)k, dt), product_of(share, dt));
    for (int i = 0; i < ANGLES; ++i) {
        turning cosine, sine;
        circle(times(t, frame->rate[i]), &cosine, &sine);
        at->cosine[i] = (real)cosine;
        at->sine[i] = (real)sine;
    }
}

/* The state (q, p) after k steps; either may be NULL. */
static void turn_state(const frame_t *frame, real dt, long k, real *q, real *p)
{
    angles_t at;
    real x[N];
    if (k == 0 || !frame->moves)
        return;
    angles_after(frame, dt, k, 0, &at);
    if (q != NULL) {
        turn_coordinates(frame->parameters, at.cosine, at.sine, frame->axis, q, x);
        for (int a = 0; a < N; ++a)
            q[a] = x[a];
    }
    if (p != NULL) {
        turn_momenta(frame->parameters, at.cosine, at.sine, frame->axis, p, x);
        for (int a = 0; a < N; ++a)
            p[a] = x[a];
    }
}
