/* ------------------------------------------------------------------ constraints: G cell by cell */

/* A criterion of the projections: how much of round-off may be left where nothing shrinks. */
enum { SLACK_OF_PLACE = 1024, SLACK_OF_MOMENTUM = 1024 };

/* f <- W^-1 f with W = G H_pp G^T */
static int solve_momentum(const constants *c, const real q[N], const real p[N], real f[M])
{
    real W[FACTOR];
    schur(c, q, p, W);
    factor(W);
    substitute(W, f);
    return isfinite(norm(M, f)) ? OK : SINGULAR;
}

/* g <- (G G^T)^-1 g */
static int solve_place(const constants *c, const real q[N], real g[M])
{
    real W[FACTOR];
    gram(c, q, W);
    factor(W);
    substitute(W, g);
    return isfinite(norm(M, g)) ? OK : SINGULAR;
}
