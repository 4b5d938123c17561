/*
 * Many equal molecules: each lane has a molecule, whose flows are those of a single one; kicks and H
 * have loops over pairs. A step of the composition has in place of T(a h) K(b h) T(a' h)
 *
 *     T(a h) R(b h/2) K(b h) R*(b h/2) T(a' h)
 *
 * with R the rotations of asymmetric molecules and R* the same in reverse order: each kick evaluates
 * each pair once.
 */
#ifndef GS_SPLITTING_MOLECULES_H
#define GS_SPLITTING_MOLECULES_H

#include "gyrospark/splitting/start.h"
#include "gyrospark/splitting/molecule_constraints.h"

enum { BLOCKS = (MOLECULES + LANES - 1)/LANES };

/* What a step changes. Lanes behind the last molecule have states of their own, without forces. */
typedef struct {
    lanes_flow_state block[BLOCKS];
} molecules_state;

/* The points and vectors that the molecules of a block carry, or the forces on these. */
typedef struct {
    lanes of[VECTORS];
} carried;

typedef struct {
    flows one;       /* rates and durations, the time step, the time */
    lanes_flows all; /* the same in each lane; its state is that of one block at a time */
    lanes_constants constants;
    int is_underway;
    molecules_state now, before;
    carried vectors[BLOCKS], force[BLOCKS];
} molecules_t;

_Static_assert(sizeof(lanes_flows) >= FLOW_NUMBERS*sizeof(lanes)
    && sizeof(flows) >= FLOW_NUMBERS*sizeof(real), "the members of flows are counted wrongly");

/* Sets the constants of a run in each lane. */
static void set_all_constants(lanes_constants *to, const constants *from)
{
    for (int lane = 0; lane < LANES; ++lane)
        set_constants(to, lane, from);
    to->_used = LANES;
}

/* The molecule in a lane of a block; in lanes behind the last one the first again. */
static int molecule_in(int block, int lane)
{
    const int i = block*LANES + lane;
    return i < MOLECULES ? i : 0;
}

/* Sets the numbers of a run with the time step one.h in each lane. */
static void prepare_molecules(molecules_t *s, const constants *c)
{
    prepare_flows(&s->one, c, s->one.h);
    const real *numbers = (const real *)(const void *)&s->one;
    lanes *in_lanes = (lanes *)(void *)&s->all;
    for (size_t e = 0; e < FLOW_NUMBERS; ++e)
        in_lanes[e] = splat(numbers[e]);
    s->all.stages = s->one.stages;
    s->all.is_symmetric = s->one.is_symmetric;
    set_all_constants(&s->constants, c);
}

/* Starts from (q, p), with the numbers of a run already set. */
static void start_molecules(molecules_t *s, const real q[N], const real p[N])
{
    for (int block = 0; block < BLOCKS; ++block)
        for (int lane = 0; lane < LANES; ++lane) {
            const int i = molecule_in(block, lane);
            start_flows(&s->one, q + COORDINATES*i, p + COORDINATES*i);
            const real *numbers = (const real *)(const void *)&s->one.now;
            lanes *now = (lanes *)(void *)&s->now.block[block];
            for (size_t e = 0; e < sizeof(flow_state)/sizeof(real); ++e)
                lane_set(&now[e], lane, numbers[e]);
        }
    s->is_underway = 0;
}

/* The vectors of molecule i in each lane. */
INLINE void broadcast_vectors(const carried *vectors, int i, lanes of_one[VECTORS])
{
    for (int k = 0; k < VECTORS; ++k)
        of_one[k] = splat(lane_get(&vectors[i/LANES].of[k], i % LANES));
}

/* Which lanes of a block have molecules behind molecule i. */
INLINE lanes_mask partners_of(int i, int block)
{
    lanes behind = splat(0);
    for (int lane = 0; lane < LANES; ++lane) {
        const int j = block*LANES + lane;
        lane_set(&behind, lane, (real)(i < j && j < MOLECULES));
    }
    return behind > splat(0);
}

/* Adds the forces between one molecule and those of a block that are its partners. */
NOINLINE void add_some_pairs(const lanes_constants *c, lanes_mask partners,
    const lanes a[VECTORS], const lanes b[VECTORS], lanes on_one[VECTORS], lanes on_block[VECTORS])
{
    lanes on_a[VECTORS], on_b[VECTORS];
    lanes_pair_force(c, a, b, on_a, on_b);
    for (int k = 0; k < VECTORS; ++k) {
        on_one[k] += lanes_select_value(partners, on_a[k], splat(0));
        on_block[k] += lanes_select_value(partners, on_b[k], splat(0));
    }
}

/* The forces on the vectors of all molecules, each pair once. */
static void add_pair_forces(const lanes_constants *c, const carried *vectors, carried *force)
{
    for (int i = 0; i < MOLECULES; ++i) {
        const int own = i/LANES;
        lanes a[VECTORS], sum[VECTORS], on_a[VECTORS], on_b[VECTORS];
        broadcast_vectors(vectors, i, a);
        for (int k = 0; k < VECTORS; ++k)
            sum[k] = splat(0);
        add_some_pairs(c, partners_of(i, own), a, vectors[own].of, sum,
            force[own].of);
        for (int block = own + 1; block < BLOCKS - 1; ++block) {
            lanes_pair_force(c, a, vectors[block].of, on_a, on_b);
            for (int k = 0; k < VECTORS; ++k) {
                sum[k] += on_a[k];
                force[block].of[k] += on_b[k];
            }
        }
        if (own < BLOCKS - 1)
            add_some_pairs(c, partners_of(i, BLOCKS - 1), a,
                vectors[BLOCKS - 1].of, sum, force[BLOCKS - 1].of);
        for (int k = 0; k < VECTORS; ++k) {
            real total = lane_get(&force[own].of[k], i % LANES);
            for (int lane = 0; lane < LANES; ++lane)
                total += lane_get(&sum[k], lane);
            lane_set(&force[own].of[k], i % LANES, total);
        }
    }
}

/* Kick i of all molecules: by the pairs, and by the potential of each alone. */
static void kick_molecules(molecules_t *s, int i)
{
    const lanes_constants *c = &s->constants;
    const lanes duration = s->all.kick[i], t[1] = { splat(0) }, gradient[1] = { splat(0) };
    for (int block = 0; block < BLOCKS; ++block) {
        lanes_molecule_vectors(c, s->now.block[block].q, s->vectors[block].of);
        for (int k = 0; k < VECTORS; ++k)
            s->force[block].of[k] = splat(0);
    }
    add_pair_forces(c, s->vectors, s->force);
    for (int block = 0; block < BLOCKS; ++block) {
        lanes_flow_state *now = &s->now.block[block];
        lanes rate[Y], own[KICKED + 1];
        lanes_molecule_kick(c, now->q, s->force[block].of, rate);
        lanes_kick_rate(c, now->q, now->y, t, gradient, own);
        for (int k = 0; k < KICKED; ++k)
            rate[kicked[k]] += own[k];
        for (int e = 0; e < Y; ++e)
            lanes_accumulate(&now->y[e], &now->y_low[e], duration*rate[e]);
    }
}

/* The rotations of asymmetric molecules beside kick i: half of the time, in order or in reverse. */
static void rotate_molecules(molecules_t *s, int i, int reverse)
{
    for (int block = 0; block < BLOCKS && !s->one.is_symmetric; ++block) {
        s->all.now = s->now.block[block];
        for (int k = 0; k < FURTHER; ++k)
            lanes_rotate_further(&s->all, reverse ? FURTHER - 1 - k : k, (real)0.5*s->all.kick[i]);
        s->now.block[block] = s->all.now;
    }
}

/* One step, up to its last kick and the rotations behind it. */
static void step_molecules(molecules_t *s)
{
    for (int i = 0; i < s->one.stages; ++i) {
        const int drift = i > 0 ? i : s->is_underway ? s->one.stages + 1 : 0;
        for (int block = 0; block < BLOCKS; ++block) {
            lanes_flow_state *now = &s->now.block[block];
            (void)lanes_drift_and_turn(&s->constants, &s->all, drift, now->q, now->q_low, now->y,
                now->y_low);
        }
        rotate_molecules(s, i, 0);
        kick_molecules(s, i);
        rotate_molecules(s, i, 1);
    }
    for (int block = 0; block < BLOCKS; ++block) /* bodies of a molecule: its quaternion alone */
        lanes_normalise(s->now.block[block].q);
    s->is_underway = 1;
}

/* The state at the end of the step: the last drift on a copy. */
static void molecules_at_end(const molecules_t *s, real q[N], real p[N])
{
    lanes_flows copy = s->all;
    copy.is_underway = s->is_underway;
    for (int block = 0; block < BLOCKS; ++block) {
        lanes q_end[COORDINATES], p_end[COORDINATES], work;
        copy.now = s->now.block[block];
        lanes_end_of_step(&s->constants, &copy, q_end, p_end, &work);
        for (int lane = 0; lane < LANES && block*LANES + lane < MOLECULES; ++lane)
            for (int a = 0; a < COORDINATES; ++a) {
                q[COORDINATES*(block*LANES + lane) + a] = lane_get(&q_end[a], lane);
                p[COORDINATES*(block*LANES + lane) + a] = lane_get(&p_end[a], lane);
            }
    }
}

/* The molecules of a block, from a state. */
static void load_block(const real q[N], int block, lanes of_block[COORDINATES])
{
    for (int a = 0; a < COORDINATES; ++a)
        for (int lane = 0; lane < LANES; ++lane)
            lane_set(&of_block[a], lane, q[COORDINATES*molecule_in(block, lane) + a]);
}

/* H: the sum over molecules, and that over pairs. Nothing is kept of a block: stacks are small. */
static real hamiltonian(const constants *c, const real q[N], const real p[N])
{
    lanes_constants all;
    lanes sum = splat(0), low = splat(0), own_q[COORDINATES], own_p[COORDINATES];
    set_all_constants(&all, c);
    for (int block = 0; block < BLOCKS; ++block) {
        load_block(q, block, own_q);
        load_block(p, block, own_p);
        lanes_accumulate(&sum, &low, lanes_select_value(partners_of(-1, block),
            lanes_molecule_hamiltonian(&all, own_q, own_p), splat(0)));
    }
    for (int own = 0; own < BLOCKS; ++own) {
        carried vectors, others;
        lanes a[VECTORS], row[LANES];
        load_block(q, own, own_q);
        lanes_molecule_vectors(&all, own_q, vectors.of);
        for (int lane = 0; lane < LANES; ++lane)
            row[lane] = splat(0);
        for (int block = own; block < BLOCKS; ++block) {
            load_block(q, block, own_q);
            lanes_molecule_vectors(&all, own_q, others.of);
            for (int lane = 0; lane < LANES; ++lane) {
                broadcast_vectors(&vectors, lane, a);
                row[lane] += lanes_select_value(partners_of(own*LANES + lane, block),
                    lanes_pair_energy(&all, a, others.of), splat(0));
            }
        }
        for (int lane = 0; lane < LANES && own*LANES + lane < MOLECULES; ++lane)
            lanes_accumulate(&sum, &low, row[lane]);
    }
    real total = 0;
    for (int lane = 0; lane < LANES; ++lane)
        total += lane_get(&sum, lane) + lane_get(&low, lane);
    return total;
}

#endif
