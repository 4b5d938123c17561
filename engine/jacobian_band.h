/* The Jacobian of T1 as a band, its factors in its place. */
static int factorise_jacobian(work_t *w)
{
    return band_factorise(w->J, w->exponents, w->pivots, &w->products);
}

/* b <- J^-1 b from the factors */
static int solve_jacobian(work_t *w, real b[U])
{
    return band_substitute(w->J, w->exponents, w->pivots, b, w->forward);
}

static void spread_jacobian(const real *J, real *dense)
{
    band_spread(J, dense);
}
