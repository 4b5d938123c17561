/* H_pp G^T = c G^T: a pull changes the velocity by c times what it changes the momenta by. */
static void respond(const state_t *w, int a, real pull, real x[X])
{
    x[HAT + a] -= pull;
    x[a] -= (real)0.5*w->h*w->constants.correction*pull;
}

static void move_again(const state_t *w, real x[X])
{
    (void)w, (void)x;
}
