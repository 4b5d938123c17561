/* Runs of a batch by compositions of flows: one trajectory per lane of several registers. */
#ifndef GS_SPLITTING_BATCH_H
#define GS_SPLITTING_BATCH_H

#include "gyrospark/run/integrate.h"
#include "gyrospark/run/lane_record.h"

/*
 * Registers take each stage in turn: their operations are independent, which hides the latency of
 * square roots and quotients. Trajectories with symmetric bodies and others take other flows: each
 * kind has flows of its own, which repeat a trajectory in lanes of the other kind, so that no result
 * depends on neighbouring lanes.
 */
enum { REGISTERS = 4, TRAJECTORIES = REGISTERS*LANES, KINDS = FURTHER > 0 ? 2 : 1 };

typedef struct {
    lanes_flows flows;
    lanes_constants constants;
} lanes_motion;

/* The part of a batch that a step changes. */
typedef struct {
    lanes_flow_state now[KINDS][REGISTERS];
    int is_underway[KINDS][REGISTERS];
} moving_part;

/* State of a batch, inside the caller's batch memory. */
typedef struct {
    lanes_motion motions[KINDS][REGISTERS];
    lanes_record records[REGISTERS];
    lanes start[REGISTERS], h[REGISTERS]; /* time at the start of the run, time step */
    long done, recorded;
    int kind[TRAJECTORIES], present[KINDS];
    moving_part before, previous;
} ensemble_t;

_Static_assert(sizeof(ensemble_t) + 64 <= sizeof(((batch_memory *)0)->memory),
    "batch memory is too small");

/* The state of a batch in its memory. */
static ensemble_t *ensemble_of(batch_memory *memory)
{
    return ALIGNED(memory->memory);
}

_Static_assert(sizeof(lanes_flows) >= FLOW_NUMBERS*sizeof(lanes)
    && sizeof(flows) >= FLOW_NUMBERS*sizeof(real), "the members of flows are counted wrongly");

/* Copies the numbers of one trajectory to a lane; both types have the same members. */
static void set_lane(lanes_motion *to, int lane, const flows *from, const constants *c)
{
    const real *numbers = (const real *)(const void *)from;
    lanes *in_lanes = (lanes *)(void *)&to->flows;
    for (size_t e = 0; e < FLOW_NUMBERS; ++e)
        lane_set(&in_lanes[e], lane, numbers[e]);
    to->flows.stages = from->stages;
    to->flows.is_symmetric = from->is_symmetric;
    to->flows.is_underway = from->is_underway;
    set_constants(&to->constants, lane, c);
    to->constants._used = LANES;
}

/* States of the trajectories in a register at the end of a step, and the work until then. */
typedef struct {
    lanes q[N], p[N], work;
} lanes_state;

/* Sets the states of a register; each lane takes them from the flows of its kind. */
static void end_of_register(const ensemble_t *b, int at, lanes_state *end)
{
    lanes_state own;
    for (int kind = 0; kind < KINDS; ++kind) {
        if (!b->present[kind])
            continue;
        const lanes_motion *motion = &b->motions[kind][at];
        lanes_end_of_step(&motion->constants, &motion->flows, own.q, own.p, &own.work);
        own.work += motion->flows.now.work + motion->flows.now.work_low;
        for (int i = 0; i < LANES; ++i) {
            if (b->kind[at*LANES + i] != kind)
                continue;
            for (int a = 0; a < N; ++a) {
                lane_set(&end->q[a], i, lane_get(&own.q[a], i));
                lane_set(&end->p[a], i, lane_get(&own.p[a], i));
            }
            lane_set(&end->work, i, lane_get(&own.work, i));
        }
    }
}

/* Adds the errors of a state to the records. */
static void observe_register(ensemble_t *b, int at, const lanes_state *end)
{
    lanes_record *record = &b->records[at];
    for (int kind = 0; kind < KINDS; ++kind) {
        if (!b->present[kind])
            continue;
        const lanes_constants *c = &b->motions[kind][at].constants;
        const lanes_record before = *record;
        const lanes *g = NULL, *f = NULL;
        lanes other = splat(0);
#if GS_CONSTRAINED
        lanes values[M], hidden[M];
        lanes_constraint(c, end->q, values);
        lanes_hidden_constraint(c, end->q, end->p, hidden);
        g = values;
        f = hidden;
#endif
        observe_lanes(record, lanes_hamiltonian(c, end->q, end->p), end->work, g, f);
        for (int i = 0; i < LANES; ++i)
            lane_set(&other, i, (real)(b->kind[at*LANES + i] != kind));
        assign_lanes(other > splat(0), sizeof(before)/sizeof(lanes), &before.energy_start,
            &record->energy_start);
    }
}

/* Copies state and report of a trajectory to the caller. */
static void write_trajectory(const ensemble_t *b, int i, const lanes_state *end, real *q, real *p,
    report_t *report)
{
    const int lane = i % LANES;
    IF_FORCES(report->work = lane_get(&end->work, lane);)
    write_record(&b->records[i/LANES], lane, report);
    for (int a = 0; a < N; ++a) {
        q[i*N + a] = lane_get(&end->q[a], lane);
        p[i*N + a] = lane_get(&end->p[a], lane);
    }
}

static int is_finite_trajectory(const ensemble_t *b, int i)
{
    const lanes_flow_state *now = &b->motions[b->kind[i]][i/LANES].flows.now;
    real size = 0;
    for (int a = 0; a < N; ++a)
        size += lane_get(&now->q[a], i % LANES);
    for (int e = 0; e < Y; ++e)
        size += lane_get(&now->y[e], i % LANES);
    return isfinite(size);
}

#if GS_TIME_DEPENDENT
/* Sets the time in H of a register. */
static void set_register_time(ensemble_t *b, int at, lanes t)
{
    for (int kind = 0; kind < KINDS; ++kind)
        lanes_at_time(&b->motions[kind][at].constants, t);
}
#else
#define set_register_time(b, at, t) ((void)0)
#endif

/* Begins a batch of `count` trajectories; unused lanes repeat the first. */
static void begin_ensemble(ensemble_t *b, int count, const parameters_t *parameters, const real *dt,
    const real *q, const real *p, report_t *reports)
{
    b->done = 0;
    b->recorded = 1;
    for (int kind = 0; kind < KINDS; ++kind)
        b->present[kind] = 0;
    for (int i = 0; i < TRAJECTORIES; ++i) {
        const int from = i < count ? i : 0;
        flows one = { 0 };
        constants c;
        prepare(&parameters[from], &c);
        one.h = dt[from];
        prepare_flows(&one, &c, one.h);
        start_flows(&one, q + from*N, p + from*N);
        const int kind = b->kind[i] = KINDS > 1 && one.is_symmetric;
        for (int e = 0; e < TRAJECTORIES && !b->present[kind]; ++e) /* for lanes of other kinds */
            set_lane(&b->motions[kind][e/LANES], e % LANES, &one, &c);
        b->present[kind] = 1;
        set_lane(&b->motions[kind][i/LANES], i % LANES, &one, &c);
        lanes_record *record = &b->records[i/LANES];
        report_t start = { 0 };
        start.recorded = 1;
        start.energy_start = hamiltonian(AT(&c, one.t = start_time(&parameters[from])),
            q + from*N, p + from*N);
        observe(&c, q + from*N, p + from*N, &start);
        lane_set(&b->start[i/LANES], i % LANES, one.t);
        lane_set(&b->h[i/LANES], i % LANES, dt[from]);
        lane_set(&record->energy_start, i % LANES, start.energy_start);
        lane_set(&record->energy_error_max, i % LANES, start.energy_error_max);
        lane_set(&record->energy_error_sum, i % LANES, start.energy_error_sum);
        lane_set(&record->constraint_max, i % LANES, start.constraint_max);
        lane_set(&record->constraint_sum, i % LANES, start.constraint_sum);
        lane_set(&record->hidden_max, i % LANES, start.hidden_max);
        lane_set(&record->hidden_sum, i % LANES, start.hidden_sum);
        if (i < count)
            reports[i] = start;
    }
}

int NAME(lanes)(void)
{
    return TRAJECTORIES;
}

#if GS_INPUTS
/* Sets the inputs of the next step in every lane. */
static void set_batch_inputs(ensemble_t *b, const inputs_t *inputs, int count, long n)
{
    constants c;
    for (int i = 0; i < TRAJECTORIES && inputs->values != NULL; ++i) {
        set_step_inputs(&c, inputs, i < count ? i : 0, n);
        for (int kind = 0; kind < KINDS; ++kind)
            lanes_set_inputs(&b->motions[kind][i/LANES].constants, i % LANES, &c);
    }
}
#endif

/* One step of all trajectories, up to its last kick. */
static void step_batch(ensemble_t *b, int registers, IF_INPUTS(
    const inputs_t *inputs, int count,) long n)
{
    IF_INPUTS(set_batch_inputs(b, inputs, count, n);)
    for (int kind = 0; kind < KINDS; ++kind) {
        if (!b->present[kind])
            continue;
        lanes_motion *motions = b->motions[kind];
        for (int at = 0; at < registers; ++at)
            motions[at].flows.t = b->start[at] + (real)n*b->h[at];
        for (int i = 0; i < motions[0].flows.stages; ++i)
            for (int at = 0; at < registers; ++at)
                lanes_take_stage(&motions[at].constants, &motions[at].flows, i);
    }
}

/* Copies what a step changes, to take steps again. */
static void save_batch(const ensemble_t *b, moving_part *to)
{
    for (int kind = 0; kind < KINDS; ++kind)
        for (int at = 0; at < REGISTERS; ++at) {
            to->is_underway[kind][at] = b->motions[kind][at].flows.is_underway;
            if (b->present[kind])
                to->now[kind][at] = b->motions[kind][at].flows.now;
        }
}

static void restore_batch(ensemble_t *b, const moving_part *from)
{
    for (int kind = 0; kind < KINDS; ++kind)
        for (int at = 0; at < REGISTERS; ++at) {
            b->motions[kind][at].flows.is_underway = from->is_underway[kind][at];
            if (b->present[kind])
                b->motions[kind][at].flows.now = from->now[kind][at];
        }
}

/* Integrates one batch in place; the public header documents the arguments. */
static void integrate_lanes(int count, const parameters_t *parameters, const options_t *options,
    IF_INPUTS(inputs_t inputs,)
    const real *dt, long steps, long every, long rows, real *q, real *p, rows_t out,
    report_t *reports, int *status, batch_memory *batch, work_t *work)
{
    ensemble_t *b = ensemble_of(batch);
    const int registers = (count + LANES - 1)/LANES;
    int alive_count = 0;
    (void)options, (void)work;
    if (count <= 0)
        return;
    if (reports[0].steps == 0 && status[0] == OK)
        begin_ensemble(b, count, parameters, dt, q, p, reports);
    for (int i = 0; i < count; ++i)
        alive_count += status[i] == OK;
    const long begun = b->done, end = begun + steps;
    while (b->done < end && alive_count > 0) {
        const long first = b->done;
        long last = first + 1; /* the next step that is recorded or stored */
        while (last < end && !is_observed(last) && (last - begun) % every != 0)
            ++last;
        lanes_state state;
        save_batch(b, &b->before);
        for (long n = first; n < last; ++n)
            step_batch(b, registers, IF_INPUTS(&inputs, count,) n);
        int fails = 0;
        for (int i = 0; i < count; ++i)
            fails |= status[i] == OK && !is_finite_trajectory(b, i);
        if (fails) { /* once more, to find the steps that fail */
            restore_batch(b, &b->before);
            for (long n = first; n < last; ++n) {
                save_batch(b, &b->previous);
                step_batch(b, registers, IF_INPUTS(&inputs, count,) n);
                for (int i = 0; i < count; ++i) {
                    if (status[i] != OK || is_finite_trajectory(b, i))
                        continue;
                    save_batch(b, &b->before); /* for the state before the failed step */
                    restore_batch(b, &b->previous);
                    end_of_register(b, i/LANES, &state);
                    restore_batch(b, &b->before);
                    write_trajectory(b, i, &state, q, p, &reports[i]);
                    reports[i].steps = n;
                    reports[i].recorded = b->recorded;
                    status[i] = NOT_FINITE;
                    --alive_count;
                }
            }
        }
        b->done = last;
        const int stored = (last - begun) % every == 0;
        b->recorded += is_observed(last);
        for (int at = 0; at < registers; ++at) {
            end_of_register(b, at, &state);
            if (is_observed(last)) {
                set_register_time(b, at, b->start[at] + (real)last*b->h[at]);
                observe_register(b, at, &state);
            }
            for (int i = at*LANES; i < count && i < (at + 1)*LANES; ++i) {
                if (status[i] != OK)
                    continue;
                real none[ROOM];
                reports[i].steps = last;
                reports[i].recorded = b->recorded;
                write_trajectory(b, i, &state, q, p, &reports[i]);
                if (stored)
                    store(out, i*rows + (last - begun)/every - 1, q + i*N, p + i*N, NULL, NULL,
                        none, 0, &reports[i]);
            }
        }
    }
}

#endif
