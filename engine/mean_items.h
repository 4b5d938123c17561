/* ---------------------------------------------------------------- sweeps: one mean value a step */

/* Where the unknowns stand: the increments dq and dp, and the impulses h lambda. */
enum { RUN(S) = 1, RUN(P) = 1 };
enum { RUN(HAT) = N, RUN(IMPULSE) = 2*N, RUN(X) = 2*N + M, RUN(RESULT) = RUN(X) };
static const int RUN(ends)[GROUPS] = { RUN(HAT), RUN(IMPULSE), RUN(X) };
static const int RUN(rows)[GROUPS] = { N, N, M };
