/* A number of the one trajectory from its lanes, which hold a part each. */
INLINE real RUN(of_lanes)(const lanes *x)
{
    real sum = part(x, 0);
    for (int i = 1; i < LANES; ++i)
        sum += part(x, i);
    return sum;
}

/* How many lanes differ. */
static int RUN(used)(void)
{
    const int stages = S, nodes = P, most = stages > nodes ? stages : nodes;
    return most < LANES ? most : LANES;
}
