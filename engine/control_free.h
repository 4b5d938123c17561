/* There are no constraints to look at. */
static void look(state_t *w)
{
    w->defect = 0;
}
