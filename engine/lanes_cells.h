/* W = G H_pp G^T without its zeros, and its factors in place of it. */
typedef lanes schur_t[FACTOR];
