/* Runs of a batch by compositions of flows: one trajectory per lane. */
#ifndef GS_SPLITTING_BATCH_H
#define GS_SPLITTING_BATCH_H

#include "gyrospark/run/integrate.h"

/*
 * State of a batch, inside the caller's batch memory. Trajectories with symmetric bodies and others
 * take other flows: each kind has lanes of its own, which repeat a trajectory where the other kind
 * is, so that no result depends on neighbouring lanes.
 */
enum { KINDS = FURTHER > 0 ? 2 : 1 };

typedef struct {
    lanes_flows flows[KINDS];
    lanes_constants constants[KINDS];
    lanes energy_start, energy_error_max, energy_error_sum;
    lanes constraint_max, constraint_sum, hidden_max, hidden_sum;
    lanes start; /* time at the start of the run */
    lanes h;
    long done;
    int kind[LANES], present[KINDS];
} ensemble_t;

_Static_assert(sizeof(ensemble_t) + 64 <= sizeof(((batch_memory *)0)->memory),
    "batch memory is too small");

static ensemble_t *ensemble_of(batch_memory *memory)
{
    return (ensemble_t *)(void *)(((size_t)memory->memory + 63) & ~(size_t)63);
}

/* Copies the numbers of one trajectory to a lane; both types have the same members. */
static void set_lane(lanes_flows *to, int lane, const flows *from)
{
    const real *numbers = (const real *)(const void *)from;
    lanes *in_lanes = (lanes *)(void *)to;
    for (size_t e = 0; e < FLOW_NUMBERS; ++e)
        lane_set(&in_lanes[e], lane, numbers[e]);
    to->stages = from->stages;
    to->is_symmetric = from->is_symmetric;
    to->is_underway = from->is_underway;
}

_Static_assert(sizeof(lanes_flows) >= FLOW_NUMBERS*sizeof(lanes)
    && sizeof(flows) >= FLOW_NUMBERS*sizeof(real), "the members of flows are counted wrongly");

/* States, energies and constraint errors of all lanes at the end of a step. */
typedef struct {
    lanes q[N], p[N], work;
} lanes_state;

static void end_of_lanes(const ensemble_t *b, lanes_state *end)
{
    lanes_state other;
    for (int kind = 0; kind < KINDS; ++kind) {
        if (!b->present[kind])
            continue;
        const lanes_flows *s = &b->flows[kind];
        lanes_end_of_step(&b->constants[kind], s, other.q, other.p, &other.work);
        other.work += s->now.work + s->now.work_low;
        for (int i = 0; i < LANES; ++i) {
            if (b->kind[i] != kind)
                continue;
            for (int a = 0; a < N; ++a) {
                lane_set(&end->q[a], i, lane_get(&other.q[a], i));
                lane_set(&end->p[a], i, lane_get(&other.p[a], i));
            }
            lane_set(&end->work, i, lane_get(&other.work, i));
        }
    }
}

/* |a| in every lane */
INLINE lanes lanes_size(lanes a)
{
    return lanes_larger(a, -a);
}

/* Adds the errors of a state to the report of each lane, as those of `count` steps. */
static void observe_lanes(ensemble_t *b, const lanes_state *end, real count)
{
    for (int kind = 0; kind < KINDS; ++kind) {
        if (!b->present[kind])
            continue;
        const lanes_constants *c = &b->constants[kind];
        lanes error = lanes_size(lanes_hamiltonian(c, end->q, end->p) - b->energy_start
            IF_FORCES(- end->work)), g_size = splat(0), f_size = splat(0);
#if GS_CONSTRAINED
        lanes g[M], f[M];
        lanes_constraint(c, end->q, g);
        lanes_hidden_constraint(c, end->q, end->p, f);
        for (int mu = 0; mu < M; ++mu) {
            g_size = lanes_larger(g_size, lanes_size(g[mu]));
            f_size = lanes_larger(f_size, lanes_size(f[mu]));
        }
#endif
        lanes own = splat(0);
        for (int i = 0; i < LANES; ++i)
            lane_set(&own, i, (real)(b->kind[i] == kind));
        const lanes_mask m = own > splat(0);
        const lanes sums[3] = { b->energy_error_sum + count*error,
            b->constraint_sum + count*g_size, b->hidden_sum + count*f_size };
        assign_lanes(m, 1, &sums[0], &b->energy_error_sum);
        assign_lanes(m, 1, &sums[1], &b->constraint_sum);
        assign_lanes(m, 1, &sums[2], &b->hidden_sum);
        const lanes largest[3] = { lanes_larger(error, b->energy_error_max),
            lanes_larger(g_size, b->constraint_max), lanes_larger(f_size, b->hidden_max) };
        assign_lanes(m, 1, &largest[0], &b->energy_error_max);
        assign_lanes(m, 1, &largest[1], &b->constraint_max);
        assign_lanes(m, 1, &largest[2], &b->hidden_max);
    }
}

/* Copies the report of a lane to the caller's report. */
static void write_report(const ensemble_t *b, int lane, const lanes *work, report_t *report)
{
    (void)work; /* without forces */
    IF_FORCES(report->work = lane_get(work, lane);)
    report->energy_error_max = lane_get(&b->energy_error_max, lane);
    report->energy_error_sum = lane_get(&b->energy_error_sum, lane);
    report->constraint_max = lane_get(&b->constraint_max, lane);
    report->constraint_sum = lane_get(&b->constraint_sum, lane);
    report->hidden_max = lane_get(&b->hidden_max, lane);
    report->hidden_sum = lane_get(&b->hidden_sum, lane);
}

/* Copies state and report of a lane to the caller. */
static void write_lane(const ensemble_t *b, const lanes_state *end, int lane, real *q, real *p,
    report_t *report)
{
    write_report(b, lane, &end->work, report);
    for (int a = 0; a < N; ++a) {
        q[lane*N + a] = lane_get(&end->q[a], lane);
        p[lane*N + a] = lane_get(&end->p[a], lane);
    }
}

static int is_finite_lane(const ensemble_t *b, int lane)
{
    const lanes_flow_state *now = &b->flows[b->kind[lane]].now;
    real size = 0;
    for (int a = 0; a < N; ++a)
        size += lane_get(&now->q[a], lane);
    for (int e = 0; e < Y; ++e)
        size += lane_get(&now->y[e], lane);
    return isfinite(size);
}

#if GS_TIME_DEPENDENT
/* Sets the time in H. */
static void set_lane_time(ensemble_t *b, lanes t)
{
    for (int kind = 0; kind < KINDS; ++kind)
        lanes_at_time(&b->constants[kind], t);
}
#else
#define set_lane_time(b, t) ((void)0)
#endif

/* Begins a batch of `count` trajectories; unused lanes repeat a trajectory of their kind. */
static void begin_ensemble(ensemble_t *b, int count, const parameters_t *parameters, const real *dt,
    const real *q, const real *p)
{
    lanes_state start;
    start.work = splat(0);
    for (int kind = 0; kind < KINDS; ++kind)
        b->present[kind] = b->flows[kind].is_underway = 0;
    b->done = 0;
    for (int round = 0; round < KINDS; ++round) /* to fill both kinds, then each lane with its own */
        for (int i = 0; i < LANES; ++i) {
            const int from = i < count ? i : 0;
            flows one = { 0 };
            constants c;
            prepare(&parameters[from], &c);
            one.h = dt[from];
            prepare_flows(&one, &c, one.h);
            start_flows(&one, q + from*N, p + from*N);
            const int kind = b->kind[i] = KINDS > 1 && one.is_symmetric;
            for (int lane = 0; lane < LANES && round == 0 && !b->present[kind]; ++lane) {
                set_lane(&b->flows[kind], lane, &one);
                set_constants(&b->constants[kind], lane, &c);
            }
            b->present[kind] = 1;
            b->constants[kind]._used = LANES;
            set_lane(&b->flows[kind], i, &one);
            set_constants(&b->constants[kind], i, &c);
            lane_set(&b->start, i, start_time(&parameters[from]));
            lane_set(&b->h, i, dt[from]);
            lane_set(&b->energy_start, i, hamiltonian(AT(&c, start_time(&parameters[from])),
                q + from*N, p + from*N));
            for (int a = 0; a < N; ++a) {
                lane_set(&start.q[a], i, q[from*N + a]);
                lane_set(&start.p[a], i, p[from*N + a]);
            }
        }
    b->energy_error_max = b->energy_error_sum = splat(0);
    b->constraint_max = b->constraint_sum = b->hidden_max = b->hidden_sum = splat(0);
    set_lane_time(b, b->start);
    observe_lanes(b, &start, 1);
}

int NAME(lanes)(void)
{
    return LANES;
}

#if GS_INPUTS
/* Sets the inputs of the next step in every lane. */
static void set_lane_inputs(ensemble_t *b, const inputs_t *inputs, int count, long n)
{
    constants c;
    for (int i = 0; i < LANES && inputs->values != NULL; ++i) {
        set_step_inputs(&c, inputs, i < count ? i : 0, n);
        for (int kind = 0; kind < KINDS; ++kind)
            lanes_set_inputs(&b->constants[kind], i, &c);
    }
}
#endif

/* One step of all lanes, up to its last kick. */
static void step_lanes(ensemble_t *b, IF_INPUTS(const inputs_t *inputs, int count,) long n)
{
    IF_INPUTS(set_lane_inputs(b, inputs, count, n);)
    for (int kind = 0; kind < KINDS; ++kind) {
        if (!b->present[kind])
            continue;
        b->flows[kind].t = b->start + (real)n*b->h;
        lanes_advance_flows(&b->constants[kind], &b->flows[kind]);
    }
}

/* The part of a batch that a step changes. */
typedef struct {
    lanes_flow_state now[KINDS];
    int is_underway[KINDS];
} moving_part;

static void save_lanes(const ensemble_t *b, moving_part *to)
{
    for (int kind = 0; kind < KINDS; ++kind) {
        to->is_underway[kind] = b->flows[kind].is_underway;
        if (b->present[kind])
            to->now[kind] = b->flows[kind].now;
    }
}

static void restore_lanes(ensemble_t *b, const moving_part *from)
{
    for (int kind = 0; kind < KINDS; ++kind) {
        b->flows[kind].is_underway = from->is_underway[kind];
        if (b->present[kind])
            b->flows[kind].now = from->now[kind];
    }
}

/* Integrates one batch in place; the public header documents the arguments. */
static void integrate_lanes(int count, const parameters_t *parameters, const options_t *options,
    IF_INPUTS(inputs_t inputs,)
    const real *dt, long steps, long every, long rows, real *q, real *p, rows_t out,
    report_t *reports, int *status, batch_memory *batch, work_t *work)
{
    ensemble_t *b = ensemble_of(batch);
    int alive_count = 0;
    (void)options, (void)work;
    if (count <= 0)
        return;
    if (reports[0].steps == 0 && status[0] == OK) {
        begin_ensemble(b, count, parameters, dt, q, p);
        const lanes none = splat(0);
        for (int i = 0; i < count; ++i) {
            reports[i].energy_start = lane_get(&b->energy_start, i);
            write_report(b, i, &none, &reports[i]);
        }
    }
    for (int i = 0; i < count; ++i)
        alive_count += status[i] == OK;
    const long begun = b->done, end = begun + steps;
    while (b->done < end && alive_count > 0) {
        const long first = b->done;
        long last = first + 1; /* the next step that is recorded or stored */
        while (last < end && !is_observed(last) && (last - begun) % every != 0)
            ++last;
        moving_part before, previous;
        lanes_state state;
        save_lanes(b, &before);
        for (long n = first; n < last; ++n)
            step_lanes(b, IF_INPUTS(&inputs, count,) n);
        int fails = 0;
        for (int i = 0; i < count; ++i)
            fails |= status[i] == OK && !is_finite_lane(b, i);
        if (fails) { /* once more, to find the steps that fail */
            restore_lanes(b, &before);
            for (long n = first; n < last; ++n) {
                save_lanes(b, &previous);
                step_lanes(b, IF_INPUTS(&inputs, count,) n);
                for (int i = 0; i < count; ++i) {
                    if (status[i] != OK || is_finite_lane(b, i))
                        continue;
                    save_lanes(b, &before); /* ahead; the state before the failed step: */
                    restore_lanes(b, &previous);
                    end_of_lanes(b, &state);
                    restore_lanes(b, &before);
                    write_lane(b, &state, i, q, p, &reports[i]);
                    reports[i].steps = n;
                    status[i] = NOT_FINITE;
                    --alive_count;
                }
            }
        }
        b->done = last;
        const int stored = (last - begun) % every == 0;
        end_of_lanes(b, &state);
        if (is_observed(last)) {
            set_lane_time(b, b->start + (real)last*b->h);
            observe_lanes(b, &state, (real)(last <= OBSERVED_STEPS ? 1 : OBSERVED_EVERY));
        }
        for (int i = 0; i < count; ++i) {
            if (status[i] != OK)
                continue;
            reports[i].steps = last;
            write_lane(b, &state, i, q, p, &reports[i]);
            if (stored) {
                real none[ROOM];
                store(out, i*rows + (last - begun)/every - 1, q + i*N, p + i*N, NULL, NULL, none, 0,
                    &reports[i]);
            }
        }
    }
}

#endif
