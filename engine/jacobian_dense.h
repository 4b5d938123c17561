/* The Jacobian of T1 as U rows of U, its factors in its place. */
static int factorise_jacobian(work_t *w)
{
    return lu_factorise(U, w->J, w->exponents, w->pivots, &w->products);
}

/* b <- J^-1 b from the factors */
static int solve_jacobian(work_t *w, real b[U])
{
    return lu_substitute(U, w->J, w->exponents, w->pivots, b);
}

static void spread_jacobian(const real *J, real *dense)
{
    for (int e = 0; e < U*U; ++e)
        dense[e] = J[e];
}
