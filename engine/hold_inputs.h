void NAME(set_inputs)(work_t *w, const real u[INPUTS])
{
    set_inputs(&w->constants, u);
}
