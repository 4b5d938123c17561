/* ------------------------------------------------------ sweeps: the stages of one step in lanes */

/*
 * Items of as many stages as lanes, or of constraint nodes 1..P-1 and last P (where g is asked for)
 * or 0 (where a multiplier acts). The scaled unknowns L = h b k and L^ = h b^ k^ stand item by
 * item, then h b~ Lambda.
 */
enum { RUN(PER) = LANES, RUN(S) = (S + LANES - 1)/LANES, RUN(P) = (P + LANES - 1)/LANES };
enum { RUN(HAT) = RUN(S)*N, RUN(IMPULSE) = 2*RUN(S)*N, RUN(X) = 2*RUN(S)*N + RUN(P)*M };
static const int RUN(ends)[GROUPS] = { RUN(HAT), RUN(IMPULSE), RUN(X) };
static const int RUN(rows)[GROUPS] = { N, N, M };
