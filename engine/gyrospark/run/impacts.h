/* Integration of one trajectory with impacts: Newton's law where gaps fall to zero. */
#ifndef GS_RUN_IMPACTS_H
#define GS_RUN_IMPACTS_H

#include "gyrospark/derivatives/motion.h"
#include "gyrospark/linear_algebra/dense_lu.h"
#include "gyrospark/run/integrate.h"

/*
 * A gap phi(q, t) >= 0 is a quantity of the system. Where it falls through 0 within a step, the part
 * of the step up to there is taken, the momenta jump, and the rest of the step is taken: the grid
 * start + k dt of the run is kept. The law of restitution e, in the metric K = H_pp, is
 *
 *     n = phi_q^T - G^T (G K G^T)^-1 G K phi_q^T          K-orthogonal to the rows of G
 *     a = phi' - phi_q K G^T (G K G^T)^-1 (G H_p + g_t)    the rate along n
 *     p <- p - (1 + e) a/(n^T K n) n
 *
 * so that a <- -e a and G H_p stays. For e = 1 and phi_t = 0 it is a reflection in K, which keeps H
 * whatever G H_p is. (Moreau, Unilateral contact and dry friction, 1988; docs/theory/impacts.md)
 */

/* Why integrate_impacts returns early, besides the failures of a step. */
enum { HITS_FULL = 16, AT_REST, INSIDE, UNMOVABLE, NOT_QUADRATIC, LATCHED };

/*
 * Numbers of a hit: time since the last grid point, impulse, loss of H, work of the forces; q, p
 * before and after.
 */
enum { STATES_OF_HIT = 4, HIT = STATES_OF_HIT + 3*N };

/* Impacts at one place, Newton's iterations, and bisections for a turning point, at most. */
enum { MOST_AT_ONCE = 10000, MOST_ITERATIONS = 200, MOST_BISECTIONS = 60 };

/* A state, its gaps with their rates along time, and the step that led there. */
typedef struct {
    real q[N], p[N], gap[QUANTITIES], rate[QUANTITIES], forces[ROOM];
    int taken;
    report_t own;
} gap_state;

typedef struct {
    const parameters_t *parameters;
    const options_t *options;
    IF_INPUTS(inputs_t inputs;)
    work_t *work;
    derivatives_t *d; /* scratch */
    real origin, dt, direction; /* t of the start, of which gaps are functions */
    int gaps;
    const int *gap;
    const int *depends; /* on the coordinates, a row for each gap */
    const real *restitution;
    const int *ends; /* whether the run ends where a gap closes, before the momenta jump */
    real margin[QUANTITIES]; /* round-off of each gap */
    long jumps; /* impacts, and those of round-off, which are not kept */
    /* Memory of hits, and one more place: the gap for which the run returns early. */
    long capacity, *count, *places;
    real *hits;
    int tried; /* whether parts of the present step were taken in search of its lowest gap */
    int step_iterations; /* of the present step, whose parts between impacts are solved apart */
    int most; /* iterations of a step since the last stored row */
    gap_state from, end, trial;
} impact_run;

/* Time of the evaluation of kernels, `since` after grid point n. */
static const constants *constants_at(impact_run *r, long n, real since)
{
    (void)n, (void)since;
    return AT(&r->work->constants, start_time(r->parameters) + (real)n*r->dt + since);
}

/* Evaluates the gaps of a state and their rates. */
static void evaluate_gaps(impact_run *r, long n, real since, gap_state *s)
{
    const real t = r->origin + (real)n*r->dt + since;
    const real at_rest[N] = { 0 };
    real v[N], force[N];
    rates_of_state(constants_at(r, n, since), s->q, s->p, v, force);
    quantities_at(r->parameters, t, s->q, s->p, s->gap);
    quantity_rates_at(r->parameters, t, s->q, s->p, v, at_rest, 1, s->rate);
}

/* Takes a step of length h from a state `since` after grid point n, without history. */
static int take_part(impact_run *r, long n, real since, real h, const gap_state *from, gap_state *to)
{
    work_t *w = r->work;
    const report_t nothing = { 0 };
    to->own = nothing;
    for (int a = 0; a < N; ++a) {
        to->q[a] = from->q[a];
        to->p[a] = from->p[a];
    }
    w->t = start_time(r->parameters) + (real)n*r->dt + since;
    IF_TIME(w->step = h;)
    IF_INPUTS(set_step_inputs(&w->constants, &r->inputs, 0, n);)
    to->own.energy_start = hamiltonian(AT(&w->constants, w->t), to->q, to->p);
    begin_run(w, r->options, h, to->q, to->p);
    const int status = advance_run(w, r->options, h, to->q, to->p, to->forces, &to->taken, &to->own);
    if (status != OK)
        return status;
#if GS_FIXED_POINT && GS_CONSTRAINED
    if (!BY_NEWTON(r->options)) /* Newton's method has stored them */
        SINGLE(multipliers)(&fixed_point_of(w)->solver, 0, to->forces);
#endif
    evaluate_gaps(r, n, since + h, to);
    return OK;
}

/*
 * Whether gap g is negative somewhere within a step of length *h that ends at r->end. A gap that is
 * positive at both ends is taken as convex between them: its tangents bound it from below. If it is
 * negative, *h and r->end become such a place.
 */
static int crosses(impact_run *r, long n, real since, int g, real *h, int *status)
{
    const real ahead = r->direction, margin = r->margin[g];
    real low = 0, high = *h, gap_low = r->from.gap[g], gap_high = r->end.gap[g];
    real rate_low = ahead*r->from.rate[g], rate_high = ahead*r->end.rate[g];
    if (gap_high < -margin)
        return 1;
    for (int k = 0; k < MOST_BISECTIONS && rate_low < 0 && rate_high > 0; ++k) {
        const real length = ahead*(high - low);
        const real meet = (gap_low - gap_high + rate_high*length)/(rate_high - rate_low);
        if (!(gap_low + rate_low*meet < -margin))
            return 0;
        const real share = k % 2 ? (real)0.5 : rate_low/(rate_low - rate_high);
        const real now = low + share*(high - low);
        r->tried = 1;
        *status = take_part(r, n, since, now, &r->from, &r->trial);
        if (*status != OK)
            return 0;
        if (r->trial.gap[g] < -margin) {
            *h = now;
            r->end = r->trial;
            return 1;
        }
        if (ahead*r->trial.rate[g] < 0) {
            low = now;
            gap_low = r->trial.gap[g];
            rate_low = ahead*r->trial.rate[g];
        } else {
            high = now;
            gap_high = r->trial.gap[g];
            rate_high = ahead*r->trial.rate[g];
        }
    }
    return 0;
}

/*
 * Moves *h and r->end, where gap g is negative, to its zero, by Newton's method within a bracket. A
 * gap that is zero at the start of the part rises there first, so that 0 counts as positive.
 */
static int locate_zero(impact_run *r, long n, real since, int g, real *h)
{
    const real ahead = r->direction, resolution = 2*epsilon*MATH(fabs)(r->dt);
    real low = 0, high = *h, now = *h;
    for (int k = 0; k < MOST_ITERATIONS && r->end.gap[g] != 0; ++k) {
        real next = now - r->end.gap[g]/r->end.rate[g];
        if (!(ahead*next > ahead*low && ahead*next < ahead*high))
            next = low + (high - low)/2;
        if (MATH(fabs)(next - now) <= resolution || next == low || next == high)
            break;
        const int status = take_part(r, n, since, next, &r->from, &r->end);
        if (status != OK)
            return status;
        now = next;
        if (r->end.gap[g] < 0)
            high = now;
        else
            low = now;
    }
    *h = now;
    return OK;
}

/* Applies the law of one gap with gradient `row` and phi_t `drift` to p; impulse and loss of H. */
static int apply_impact(impact_run *r, const constants *at, const real row[N], real drift,
    real e, const real q[N], real p[N], real *impulse, real *loss)
{
    real K[N][N], v[N], force[N], normal[N], moved[N], before[N];
    real rate = drift, size = MATH(fabs)(drift), reach = 0, kappa = 0, along = 0, rest = 0;
    evaluate_inverse_mass(at, q, p, &K[0][0], r->d);
    rates_of_state(at, q, p, v, force);
    for (int a = 0; a < N; ++a) {
        normal[a] = row[a];
        before[a] = p[a];
        rate += row[a]*v[a];
        size += MATH(fabs)(row[a]*v[a]);
        for (int b = 0; b < N; ++b)
            reach += row[a]*K[a][b]*row[b];
    }
#if GS_CONSTRAINED
    real G[M][N], KG[M][N], W[M][M], x[M], slip[M];
    int exponents[M], pivots[M];
    long products;
    for (int mu = 0; mu < M; ++mu) {
        real unit[M] = { 0 };
        unit[mu] = 1;
        constraint_force(at, q, unit, G[mu]);
        x[mu] = 0;
        for (int a = 0; a < N; ++a) {
            KG[mu][a] = 0;
            for (int b = 0; b < N; ++b)
                KG[mu][a] += K[a][b]*G[mu][b];
            x[mu] += row[a]*KG[mu][a];
        }
    }
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu) {
            W[mu][nu] = 0;
            for (int a = 0; a < N; ++a)
                W[mu][nu] += G[mu][a]*KG[nu][a];
        }
    hidden_constraint(at, q, p, slip);
    int status = solve_momentum(at, q, p, slip);
    for (int mu = 0; mu < M; ++mu)
        rate -= x[mu]*slip[mu];
    status = status == OK ? lu_factorise(M, &W[0][0], exponents, pivots, &products) : status;
    status = status == OK ? lu_substitute(M, &W[0][0], exponents, pivots, x) : status;
    if (status != OK)
        return status;
    for (int a = 0; a < N; ++a)
        for (int mu = 0; mu < M; ++mu)
            normal[a] -= G[mu][a]*x[mu];
#endif
    for (int a = 0; a < N; ++a) {
        moved[a] = 0;
        for (int b = 0; b < N; ++b)
            moved[a] += K[a][b]*normal[b];
        kappa += normal[a]*moved[a];
        along += normal[a]*v[a];
    }
    if (!(kappa > 1024*epsilon*reach))
        return UNMOVABLE;
    real c = (1 + e)*rate/kappa;
#if GS_TIME_DEPENDENT
    drift = rate - along; /* g_t too */
#endif
    *loss = c*((1 - e)/2*rate - drift);
    for (int a = 0; a < N; ++a)
        p[a] = before[a] - c*normal[a];
    /* The round-off of p changes H: a correction of c takes it back, unless it is no round-off. */
    const real H = hamiltonian(at, q, before);
    const real correction = (hamiltonian(at, q, p) - H + *loss)/(c*kappa - along);
    if (MATH(fabs)(correction) <= MATH(fabs)(c)*MATH(ldexp)(1, -26)) {
        c -= correction;
        for (int a = 0; a < N; ++a)
            p[a] = before[a] - c*normal[a];
    }
    *impulse = -c;
    rates_of_state(at, q, p, moved, force);
    for (int a = 0; a < N; ++a)
        rest += normal[a]*(moved[a] - v[a]);
    return MATH(fabs)(rest + (1 + e)*rate) <= MATH(ldexp)(size, -20) ? OK : NOT_QUADRATIC;
}

/* Gradients of the quantities at a state, a row for each coordinate, and their rates at rest. */
static void evaluate_gradients(impact_run *r, long n, real since, const gap_state *s,
    real rows[N][QUANTITIES], real drifts[QUANTITIES])
{
    const real t = r->origin + (real)n*r->dt + since, zero[N] = { 0 };
    quantity_rates_at(r->parameters, t, s->q, s->p, zero, zero, 1, drifts);
    for (int a = 0; a < N; ++a) {
        real unit[N] = { 0 };
        unit[a] = 1;
        quantity_rates_at(r->parameters, t, s->q, s->p, unit, zero, 0, rows[a]);
    }
}

/* Estimates the round-off of each gap. */
static void update_margins(impact_run *r, long n, real since, const gap_state *s)
{
    const real t = r->origin + (real)n*r->dt + since;
    real rows[N][QUANTITIES], drifts[QUANTITIES];
    evaluate_gradients(r, n, since, s, rows, drifts);
    for (int j = 0; j < r->gaps; ++j) {
        const int g = r->gap[j];
        real size = MATH(fabs)(drifts[g]*t) + MATH(fabs)(s->rate[g]*r->dt), q = 0;
        /* A small component of a quaternion has the round-off of a large one. */
        for (int a = 0; a < N; ++a)
            q = r->depends[j*N + a] ? larger(q, MATH(fabs)(s->q[a])) : q;
        for (int a = 0; a < N; ++a)
            size += MATH(fabs)(rows[a][g])*q;
        r->margin[g] = 16*epsilon*size;
    }
}

/* Whether a gap is zero but for round-off, and falls. */
static int falls(const impact_run *r, const gap_state *s)
{
    for (int j = 0; j < r->gaps; ++j) {
        const int g = r->gap[j];
        if (MATH(fabs)(s->gap[g]) <= r->margin[g] && r->direction*s->rate[g] < 0)
            return 1;
    }
    return 0;
}

/*
 * Impacts of the gaps that are zero at a state, one after another, from the most negative rate,
 * until none falls. Those of bodies that touch at rest, whose rates are round-off, are not kept.
 */
static int resolve_impacts(impact_run *r, long n, real since, gap_state *s, report_t *report)
{
    const constants *at = constants_at(r, n, since);
    real rows[N][QUANTITIES], drifts[QUANTITIES];
    int status = OK;
    evaluate_gradients(r, n, since, s, rows, drifts);
    for (int k = 0; status == OK; ++k) {
        int worst = -1;
        real most = 0, v[N], force[N];
        rates_of_state(at, s->q, s->p, v, force);
        for (int j = 0; j < r->gaps; ++j) {
            const int g = r->gap[j];
            real rate = drifts[g], size = MATH(fabs)(drifts[g]);
            for (int a = 0; a < N; ++a) {
                rate += rows[a][g]*v[a];
                size += MATH(fabs)(rows[a][g]*v[a]);
            }
            rate *= r->direction;
            if (MATH(fabs)(s->gap[g]) <= r->margin[g] && rate < -16*epsilon*size
                && (worst < 0 || rate < most)) {
                worst = j;
                most = rate;
            }
        }
        if (worst < 0)
            break;
        r->places[2*(*r->count)] = worst;
        if (*r->count == r->capacity)
            status = HITS_FULL;
        else if (k == MOST_AT_ONCE)
            status = AT_REST;
        if (status != OK)
            break;
        real row[N], *out = r->hits + *r->count*HIT;
        for (int a = 0; a < N; ++a) {
            row[a] = rows[a][r->gap[worst]];
            out[STATES_OF_HIT + a] = s->q[a];
            out[STATES_OF_HIT + N + a] = s->p[a];
        }
        out[1] = out[2] = 0;
        if (!r->ends[worst])
            status = apply_impact(r, at, row, drifts[r->gap[worst]], r->restitution[worst], s->q,
                s->p, &out[1], &out[2]);
        for (int a = 0; a < N; ++a)
            out[STATES_OF_HIT + 2*N + a] = s->p[a];
        out[0] = since == r->dt ? 0 : since;
        out[3] = 0 IF_FORCES(+ report->work);
        r->places[2*(*r->count) + 1] = n + (since == r->dt);
        r->jumps += status == OK;
        *r->count += status == OK
            && (r->ends[worst] || -16*most*MATH(fabs)(r->dt) > r->margin[r->gap[worst]]);
        report->energy_start -= status == OK ? out[2] : 0; /* a loss is no error of the energy */
        if (status == OK && r->ends[worst]) {
            r->places[2*(*r->count)] = worst;
            status = LATCHED;
        }
    }
    evaluate_gaps(r, n, since, s);
    return status;
}

/* Begins the steps of the grid again at grid point n. */
static void begin_on_grid(impact_run *r, long n, const gap_state *s, const report_t *report)
{
    work_t *w = r->work;
    w->t = start_time(r->parameters) + (real)n*r->dt;
    begin_run(w, r->options, r->dt, s->q, s->p);
#if GS_FIXED_POINT && GS_FORCES
    fixed_point_of(w)->solver.work = splat(report->work);
    fixed_point_of(w)->solver.work_low = splat(report->work_low);
#endif
    (void)report; /* without forces */
}

/* A state on the grid; `begun` where the solver has begun again and forgotten its multipliers. */
static void store_on_grid(impact_run *r, long first, long every, rows_t out, int begun,
    report_t *report)
{
    const long done = ++report->steps - first, row = done/every - 1;
    real *multipliers = out.multipliers;
    if (r->step_iterations > report->iterations_max)
        report->iterations_max = r->step_iterations;
    if (r->step_iterations > r->most)
        r->most = r->step_iterations;
    r->step_iterations = 0;
    if (done % every != 0)
        return;
    if (begun)
        out.multipliers = NULL;
    store(out, row, r->from.q, r->from.p, r->work, r->options, r->from.forces, r->most, report);
    for (int l = 0; l < MULTIPLIERS && begun && multipliers != NULL; ++l)
        multipliers[row*MULTIPLIERS + l] = r->from.forces[l];
    r->most = 0;
}

/* Integrates up to grid point `last` from `since` after one; see the public header. */
static int run_with_impacts(impact_run *r, long last, long every, rows_t out, real *since,
    report_t *report)
{
    work_t *w = r->work;
    const long first = report->steps;
    while (report->steps < last) {
        const long n = report->steps, jumps = r->jumps;
        const report_t before = *report;
        const int whole = *since == 0;
        real h = r->dt - *since;
        int status = OK, hit = -1;
        r->tried = 0;
        if (falls(r, &r->from)) {
            status = resolve_impacts(r, n, *since, &r->from, report);
            if (status != OK)
                return status;
            if (whole && r->jumps > jumps)
                begin_on_grid(r, n, &r->from, report);
        }
        if (*since == r->dt) {
            *since = 0;
            begin_on_grid(r, n + 1, &r->from, report);
            observe(AT(&w->constants, w->t), r->from.q, r->from.p, report);
            store_on_grid(r, first, every, out, 1, report);
            continue;
        }
        if (whole) {
            gap_state *end = &r->end;
            for (int a = 0; a < N; ++a) {
                end->q[a] = r->from.q[a];
                end->p[a] = r->from.p[a];
            }
            w->t = start_time(r->parameters) + (real)n*r->dt;
            IF_TIME(w->step = start_time(r->parameters) + (real)(n + 1)*r->dt - w->t;)
            IF_INPUTS(set_step_inputs(&w->constants, &r->inputs, 0, n);)
            status = advance_run(w, r->options, r->dt, end->q, end->p, end->forces, &end->taken,
                report);
            if (status == OK)
                evaluate_gaps(r, n, r->dt, end);
        } else
            status = take_part(r, n, *since, h, &r->from, &r->end);
        for (int j = 0; j < r->gaps && status == OK; ++j)
            if (crosses(r, n, *since, r->gap[j], &h, &status)) {
                status = locate_zero(r, n, *since, r->gap[j], &h);
                hit = r->gap[j];
                r->places[2*(*r->count)] = j;
            }
        if (status != OK) {
            *report = before;
            return status;
        }
        if (whole && hit < 0 && !r->tried && !falls(r, &r->end)) {
            report->iterations += r->end.taken;
            r->step_iterations += r->end.taken;
            r->from = r->end;
            store_on_grid(r, first, every, out, 0, report);
            continue;
        }
        if (whole) {
            *report = before;
            if (h == r->dt) /* none closes before the end of the step, which is taken as a part */
                status = take_part(r, n, 0, h, &r->from, &r->end);
            if (status != OK)
                return status;
        }
        if (hit >= 0 && MATH(fabs)(r->from.gap[hit]) <= r->margin[hit]) {
            const real t = r->origin + (real)n*r->dt + *since + h;
            if (MATH(fabs)(h) <= 8*epsilon*larger(MATH(fabs)(t), MATH(fabs)(r->dt))
                || MATH(fabs)(h*r->from.rate[hit]) <= r->margin[hit])
                return AT_REST;
        }
        report->iterations += r->end.taken;
        r->step_iterations += r->end.taken;
        report->newton_steps += r->end.own.newton_steps;
        IF_FORCES(add_work(report, r->end.own.work);)
        *since += h;
        if (hit < 0 || MATH(fabs)(r->dt - *since) <= 4*epsilon*MATH(fabs)(r->dt))
            *since = r->dt;
        r->from = r->end;
        if (hit >= 0) {
            update_margins(r, n, *since, &r->from);
            /* What is left at a located zero is round-off of the gap, which may be a difference of
             * numbers larger than its coordinates. */
            r->margin[hit] = larger(r->margin[hit], MATH(fabs)(r->from.gap[hit]));
        }
    }
    return OK;
}

#endif
