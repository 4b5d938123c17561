/* A number of the one trajectory from its lanes, which are all the same. */
INLINE real RUN(of_lanes)(const lanes *x)
{
    return part(x, 0);
}

/* How many lanes differ. */
static int RUN(used)(void)
{
    return 1;
}
