/* Adds the energy of the state (q, p) to the record. */
static void observe_energy(const constants *c, const real q[N], const real p[N], report_t *report)
{
    const real gain = hamiltonian(c, q, p) - report->energy_start;
    const real error = MATH(fabs)(gain - work_so_far(report));
    report->energy_error_max = larger(error, report->energy_error_max);
    report->energy_error_sum += error;
}
