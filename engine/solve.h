/* Solves A x = b; x replaces b, the factors of A replace A. */
static int solve(int n, real *restrict A, real *restrict b, int *restrict exponents,
    int *restrict pivots)
{
    long products;
    const int status = lu_factorise(n, A, exponents, pivots, &products);
    return status == OK ? lu_substitute(n, A, exponents, pivots, b) : status;
}
