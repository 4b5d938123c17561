/* Adds what is left of the constraints to the record. */
static void observe_defects(real g_size, real f_size, report_t *report)
{
    report->constraint_max = larger(g_size, report->constraint_max);
    report->constraint_sum += g_size;
    report->hidden_max = larger(f_size, report->hidden_max);
    report->hidden_sum += f_size;
}

/* Adds the state (q, p) to the record. */
static void observe(const constants *c, const real q[N], const real p[N], report_t *report)
{
    real g[M], f[M];
    observe_energy(c, q, p, report);
    constraint(c, q, g);
    hidden_constraint(c, q, p, f);
    observe_defects(norm(M, g), norm(M, f), report);
}
