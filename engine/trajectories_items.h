/* -------------------------------------------------------- sweeps: several trajectories in lanes */

/*
 * Each stage and each node is an item, of several trajectories. The scaled unknowns L = h b k and
 * L^ = h b^ k^ stand item by item, then h b~ Lambda.
 */
enum { RUN(PER) = 1, RUN(S) = S, RUN(P) = P };
enum { RUN(HAT) = RUN(S)*N, RUN(IMPULSE) = 2*RUN(S)*N, RUN(X) = 2*RUN(S)*N + RUN(P)*M };
static const int RUN(ends)[GROUPS] = { RUN(HAT), RUN(IMPULSE), RUN(X) };
static const int RUN(rows)[GROUPS] = { (S > 1 ? 2 : 1)*N, (S > 1 ? 2 : 1)*N, (P > 1 ? 2 : 1)*M };
