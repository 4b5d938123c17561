/* Adds the state (q, p) to the record. */
static void observe(const constants *c, const real q[N], const real p[N], report_t *report)
{
    observe_energy(c, q, p, report);
}
