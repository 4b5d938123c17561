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

/* Of a stage: a drift with the turn of axes of space, then a kick, or between two halves of it the rotations of kick_and_rotate. */
enum {
    ROTATIONS = FURTHER > 0 ? 2*FURTHER - 1 : 0,
    STAGE_MAPS = DRIFT_MAPS + (FURTHER > 0 ? 2 + ROTATIONS : 1),
    STEP_MAPS = STAGES*STAGE_MAPS + DRIFT_MAPS
};

/* A map takes a share of the kick of its stage. */
typedef struct {
    int kind, stage, rotation;
    real share;
} step_map;

static inline int maps_of(int stages)
{
    return stages*STAGE_MAPS + DRIFT_MAPS;
}

static inline step_map map_of(int m)
{
    const int own = m % STAGE_MAPS, place = own - DRIFT_MAPS - 1;
    const real whole = 1, half = (real)0.5;
    step_map map = { DRIFT, m/STAGE_MAPS, 0, 0 };
    if (own < DRIFT_MAPS) {
        map.kind = own == 0 ? DRIFT : AXES_TURN;
        return map;
    }
    map.share = FURTHER > 0 ? half : whole;
    if (place < 0 || place == ROTATIONS) {
        map.kind = KICK;
        return map;
    }
    map.kind = ROTATION;
    map.rotation = place < FURTHER ? place : 2*(FURTHER - 1) - place;
    if (map.rotation == FURTHER - 1)
        map.share = whole;
    return map;
}

#endif
