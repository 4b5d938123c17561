/* What was learnt of each trajectory in lanes. */
enum { RUN(TRACKS) = LANES/RUN(PER) };

typedef struct {
    lanes next[KNOWN*2*RUN(S)];  /* the function for L and L^, of L and L^ in turn */
    lanes wave[ORDER];           /* the recurrence of all multipliers */
    lanes learnt[RUN(X)];        /* two predictions, on trial */
    lanes other[RUN(IMPULSE)];
    real error[RUN(TRACKS)];  /* of the function, squared, when it was on trial */
    int lags, order;          /* the most in use */
    int taken[RUN(TRACKS)];   /* whether a trajectory goes by its function */
    int settled[RUN(TRACKS)]; /* whether it does for good */
    int trial[RUN(TRACKS)];   /* whether the next step shows which prediction is better */
    long latest[RUN(TRACKS)]; /* when the function was fitted */
} RUN(lessons);
