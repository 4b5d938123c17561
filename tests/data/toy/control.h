/* What profile control expects besides, of either system of the toy. */
#ifndef TOY_CONTROL_H
#define TOY_CONTROL_H

#include <stdbool.h>
#include <stdint.h>

#define STATUS(name) TOY_##name
typedef enum {
    TOY_OK = 0, TOY_NOT_CONVERGED = 1, TOY_SINGULAR = 2, TOY_NOT_FINITE = 3, TOY_DIVERGED = 5,
    TOY_INVALID = 6
} toy_status;

enum { QUATERNIONS = 0 };
static const int quaternion[1][4] = { { 0, 0, 0, 0 } };

static inline bool are_valid(const toy_parameters *par)
{
    return par->k > 0;
}

#endif
