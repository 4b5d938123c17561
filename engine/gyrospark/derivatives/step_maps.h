/* The maps of a step of a composition of flows, one after another. */
#ifndef GS_DERIVATIVES_STEP_MAPS_H
#define GS_DERIVATIVES_STEP_MAPS_H

#include "gyrospark/splitting/start.h"

enum { DRIFT, AXES_TURN, KICK, ROTATION };

#if GS_ROTATING_AXES
enum { DRIFT_MAPS = 2 };
#else
enum { DRIFT_MAPS = 1 };
#endif

/*
 * Of a stage: a drift with the turn of axes of space, then the palindrome of kick_and_rotate. Where
 * the run is symmetric it takes one kick, which may depend on momenta: this is in the middle then,
 * between rotations that turn nothing, so that their derivatives have order 2.
 */
enum {
    STAGE_MAPS = DRIFT_MAPS + 2*FURTHER + 1,
    STEP_MAPS = STAGES*STAGE_MAPS + DRIFT_MAPS
};

/* A map takes a share of the kick of its stage. */
typedef struct {
    int kind, stage, rotation;
    real share;
} step_map;

/* Number of maps of a step with so many stages */
static inline int maps_of(int stages)
{
    return stages*STAGE_MAPS + DRIFT_MAPS;
}

/* Map m of a step, in the order in which maps act */
static inline step_map map_of(int is_symmetric, int m)
{
    const int own = m % STAGE_MAPS, place = own - DRIFT_MAPS;
    const int depth = place < FURTHER ? place : 2*FURTHER - place;
    step_map map = { DRIFT, m/STAGE_MAPS, 0, 0 };
    if (own < DRIFT_MAPS) {
        map.kind = own == 0 ? DRIFT : AXES_TURN;
        return map;
    }
    map.share = depth == FURTHER ? (real)1 : (real)0.5;
    if (depth == (is_symmetric ? FURTHER : 0)) {
        map.kind = KICK;
        return map;
    }
    map.kind = ROTATION;
    map.rotation = is_symmetric ? depth : depth - 1;
    return map;
}

#endif
