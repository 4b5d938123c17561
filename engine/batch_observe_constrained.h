static void observe_lane_defects(batch_t *b)
{
    MANY(t) *run = &b->run;
    lanes f[M], g_size = splat(0), f_size = splat(0);
    lanes_hidden_constraint(&run->constants, run->q, run->p, f);
    for (int mu = 0; mu < M; ++mu) {
        g_size = lanes_larger(g_size, lanes_size(run->bound.g_rounded[mu]));
        f_size = lanes_larger(f_size, lanes_size(f[mu]));
    }
    b->g_max = lanes_larger(g_size, b->g_max);
    b->g_sum += g_size;
    b->f_max = lanes_larger(f_size, b->f_max);
    b->f_sum += f_size;
}
