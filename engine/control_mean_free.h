static void begin_sweeps(state_t *w)
{
    (void)w;
}

static void constrain(state_t *w, real x[X], real G[ROOM][N])
{
    (void)w, (void)x, (void)G;
}

static void hold(real G[ROOM][N], const real *impulse, real force[N])
{
    (void)G, (void)impulse, (void)force;
}
