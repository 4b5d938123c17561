/* W, one number, is factorised by its inverse, in its place. */
static void factorise(real W[M][M])
{
    W[0][0] = 1/W[0][0];
}

static void substitute(real W[M][M], real b[M])
{
    b[0] *= W[0][0];
}
