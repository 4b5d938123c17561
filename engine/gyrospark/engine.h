/*
 * The engine of gyrospark: features, types and macros that all other headers need.
 *
 * A generated file defines its features, NAME(f), MATH(f), LIMIT(f) and its sizes, includes this
 * header and, between its kernels, the headers of the algorithms. engine/README.md lists what the
 * headers expect of the generated file. A feature is 1 where a generated file defines it, else 0.
 *
 * Macros take the place of templates and of namespaces, which C does not have:
 *
 *   NAME(f)            public function f of this stepper: NAME(step) is heavy_top_gl3_gamma_step
 *   MATH(f), LIMIT(f)  f of <math.h> and <float.h> for the type real: MATH(sqrt) is sqrtf of float
 *   IF_TIME(...)       the arguments if the feature is 1, else nothing: one feature often adds one
 *                      statement to a function, and #if would take three lines. So
 *                      IF_CONSTRAINED, IF_FACTORISED (W depends on the state), IF_FORCES, IF_INPUTS,
 *                      IF_CLOCK, IF_FRAME, IF_FRAME_WORK
 *   AT(c, t)           the constants c with the time t set in them; c if nothing depends on t
 *   BETWEEN(c, t, step)  c with the time of a mean value over t..t + step set in them
 *   LANES_AT, LANES_BETWEEN  AT and BETWEEN for constants of all lanes
 *   SINGLE(f)          function or type f of the fixed-point iteration of one trajectory
 *   BATCH(f)           the same of several trajectories, one in each lane (a lane is one number of
 *                      a vector register). IMS and EMS have one iteration for both purposes
 *   SOLVER(f)          in headers that are included for both: SINGLE(f), then BATCH(f)
 *   TABLE(x)           in these headers, table x of the tableau: in lanes for SINGLE, numbers for
 *                      BATCH
 *   COEFFICIENT, TABLE_PRODUCT  type of its numbers; storage class of products with it
 *   NUMBER, TYPED(f)   in headers that are included for numbers and for lanes (simd/numbers.h,
 *                      simd/lanes.h): real and f, then lanes and lanes_f
 *   ALIGNED(memory)    the first multiple of 64 bytes in a caller's memory, where types with vectors
 *                      begin; the public header declares bytes, 64 more than their size, for that
 *                      depends on the vector registers
 *   SEPARATE(f)        SINGLE(f), which another object file contains if the build makes several
 *   KERNEL(f)          profiles: kernel f of the fixed-point iteration, where Newton's differs
 *   INLINE, NOINLINE   storage class with the attribute that keeps vectors in registers
 *   INLINE_IF_SMALL    INLINE, but for a large system: arrays then leave the stack with the function
 */
#ifndef GS_ENGINE_H
#define GS_ENGINE_H

#define GS_ENGINE_VERSION 1 /* of the interface between generated files and the engine */
#ifndef GS_ENGINE
#error "Include this header from a file that gyrospark has generated."
#elif GS_ENGINE != GS_ENGINE_VERSION
#error "This file and the folder of -I are of different versions of gyrospark; generate it again."
#endif

#ifndef GS_CONSTRAINED /* there are constraints g(q) = 0 */
#define GS_CONSTRAINED 0
#endif
#ifndef GS_SEVERAL_CONSTRAINTS /* there are at least two */
#define GS_SEVERAL_CONSTRAINTS 0
#endif
#ifndef GS_VELOCITY_CONSTRAINTS /* there are constraints A(q) q' + a(q) = 0 */
#define GS_VELOCITY_CONSTRAINTS 0
#endif
#ifndef GS_SPARK /* a SPARK method with stages; else IMS or EMS, one mean value a step */
#define GS_SPARK 0
#endif
#ifndef GS_ELEMENTS /* H and g are sums over element templates; else written out in full */
#define GS_ELEMENTS 0
#endif
#ifndef GS_CONDENSED /* Newton's system without the rates of momenta: H_pp is invertible */
#define GS_CONDENSED 0
#endif
#ifndef GS_FORCES /* forces F(q, p, t) act */
#define GS_FORCES 0
#endif
#ifndef GS_TIME_DEPENDENT /* t occurs in H or in g */
#define GS_TIME_DEPENDENT 0
#endif
#ifndef GS_FORCED_BY_TIME /* t occurs in forces, or in H or g */
#define GS_FORCED_BY_TIME 0
#endif
#ifndef GS_CLOCK /* the last coordinate is the time t in scaled time, its momentum -H - W */
#define GS_CLOCK 0
#endif
#ifndef GS_INPUTS /* the system has inputs, which are held over a step */
#define GS_INPUTS 0
#endif
#ifndef GS_LAGRANGIAN /* H is the Legendre transform of a Lagrangian */
#define GS_LAGRANGIAN 0
#endif
#ifndef GS_ENERGY_MOMENTUM /* EMS of a Lagrangian, in the velocities of both ends */
#define GS_ENERGY_MOMENTUM 0
#endif
#ifndef GS_INDEFINITE_MASS /* the mass matrix was not proved to be positive definite */
#define GS_INDEFINITE_MASS 0
#endif
#ifndef GS_FRAME /* a co-moving frame */
#define GS_FRAME 0
#endif
#ifndef GS_FRAME_WORK /* forces do work along the motion of the frame */
#define GS_FRAME_WORK 0
#endif
#ifndef GS_ROTATING_MULTIPLIERS /* the multipliers rotate with the frame */
#define GS_ROTATING_MULTIPLIERS 0
#endif
#ifndef GS_SPLITTING /* a composition of exact flows */
#define GS_SPLITTING 0
#endif
#ifndef GS_ROTATING_AXES /* H has -omega.J: axes of space that turn */
#define GS_ROTATING_AXES 0
#endif
#ifndef GS_DRAG /* isotropic drag, a part of free motions */
#define GS_DRAG 0
#endif
#ifndef GS_MOMENTUM_FORCES /* forces of kicks depend on momenta */
#define GS_MOMENTUM_FORCES 0
#endif
#ifndef GS_FIXED_POINT /* the tableau permits the fixed-point iteration */
#define GS_FIXED_POINT 0
#endif
#ifndef GS_CONSTANT_SCHUR /* W = G H_pp G^T is constant where g = 0 */
#define GS_CONSTANT_SCHUR 0
#endif
#ifndef GS_SCALAR_SCHUR /* H_pp G^T = c G^T */
#define GS_SCALAR_SCHUR 0
#endif
#ifndef GS_FACTORS /* W is factorised */
#define GS_FACTORS 0
#endif
#ifndef GS_SEPARABLE /* H_pq = 0: Gauss-Seidel ordering */
#define GS_SEPARABLE 0
#endif
#ifndef GS_HELD /* there are constraints other than those of unit quaternions */
#define GS_HELD 0
#endif
#ifndef GS_EVEN_ODD /* products with the tableau, symmetric in time, by even and odd parts */
#define GS_EVEN_ODD 0
#endif
#ifndef GS_EXACT_ENERGY /* one number theta a step: H(q1, p1) = H_0 + work exactly */
#define GS_EXACT_ENERGY 0
#endif
#ifndef GS_SHORT_REAL /* the type has fewer digits than counters of steps */
#define GS_SHORT_REAL 0
#endif
#ifndef GS_WIDE_REAL /* no machine has vector registers for the type */
#define GS_WIDE_REAL 0
#endif
#ifndef GS_COMPENSATED_LANES /* kernels on lanes sum products in twice the working precision */
#define GS_COMPENSATED_LANES 0
#endif
#ifndef GS_LARGE /* arrays of N lanes take megabytes of the stack */
#define GS_LARGE 0
#endif
#ifndef GS_DERIVATIVES /* tangents and adjoints */
#define GS_DERIVATIVES 0
#endif
#ifndef GS_SECOND_DERIVATIVES /* derivatives of adjoints */
#define GS_SECOND_DERIVATIVES 0
#endif
#ifndef GS_DERIVATIVES_IN_LANES /* derivatives of as many steps at once as there are lanes */
#define GS_DERIVATIVES_IN_LANES 0
#endif
#ifndef GS_PROFILE_RUN /* profile run: no multipliers are returned, no batches */
#define GS_PROFILE_RUN 0
#endif
#ifndef GS_PROFILE_CONTROL /* profile control: begin and advance alone */
#define GS_PROFILE_CONTROL 0
#endif

#if !GS_PROFILE_CONTROL || GS_DERIVATIVES
/* Statements and arguments of one feature; AT and BETWEEN set the time among the constants. */
#if GS_TIME_DEPENDENT
#define IF_TIME(...) __VA_ARGS__
#define AT(c, t) at_time(c, t)
#define BETWEEN(c, t, step) between(c, t, step)
#else
#define IF_TIME(...)
#define AT(c, t) c
#define BETWEEN(c, t, step) c
#endif
#if (GS_FIXED_POINT || GS_SPLITTING) && GS_TIME_DEPENDENT
#define LANES_AT(c, t) lanes_at_time(c, t)
#define LANES_BETWEEN(c, t, step) lanes_between(c, t, step)
#elif GS_FIXED_POINT
#define LANES_AT(c, t) c
#define LANES_BETWEEN(c, t, step) c
#endif
#if GS_CONSTRAINED
#define IF_CONSTRAINED(...) __VA_ARGS__
#else
#define IF_CONSTRAINED(...)
#endif
#if GS_CONSTRAINED && !GS_CONSTANT_SCHUR
#define IF_FACTORISED(...) __VA_ARGS__
#else
#define IF_FACTORISED(...)
#endif
#if GS_FORCES
#define IF_FORCES(...) __VA_ARGS__
#else
#define IF_FORCES(...)
#endif
#if GS_INPUTS
#define IF_INPUTS(...) __VA_ARGS__
#else
#define IF_INPUTS(...)
#endif
#if GS_CLOCK
#define IF_CLOCK(...) __VA_ARGS__
#else
#define IF_CLOCK(...)
#endif
#if GS_FRAME
#define IF_FRAME(...) __VA_ARGS__
#else
#define IF_FRAME(...)
#endif
#if GS_FRAME_WORK
#define IF_FRAME_WORK(...) __VA_ARGS__
#else
#define IF_FRAME_WORK(...)
#endif
#endif

typedef NAME(parameters) parameters_t;
typedef NAME(constants) constants;
typedef NAME(options) options_t;
#if GS_PROFILE_CONTROL
typedef NAME(work) state_t;
#if GS_DERIVATIVES
typedef state_t work_t;
#endif
#else
typedef NAME(report) report_t;
typedef NAME(work) work_t;
#if GS_PROFILE_RUN && !GS_SPLITTING
typedef NAME(state) state_t;
#elif !GS_PROFILE_RUN && (GS_FIXED_POINT || GS_SPLITTING)
typedef NAME(batch) batch_memory;
#endif
#endif

/* The status of a step and its solver, as in the public header; profile control defines names. */
#if GS_PROFILE_CONTROL
typedef NAME(status) status_t;
#else
typedef int status_t;
enum { OK, NOT_CONVERGED, SINGULAR, NOT_FINITE, STAGNATED, DIVERGED, TIME_STOPPED = 7 };
enum { NEWTON = 1, FIXED_POINT };
#endif

#if GS_SPLITTING && !GS_PROFILE_CONTROL && !GS_PROFILE_RUN
#if defined(__GNUC__) && !defined(__clang__)
/* See RELOAD_STATE: hoisting moves products out of the branches whose sums they are contracted in. */
#pragma GCC optimize("no-code-hoisting")
#endif
#endif

static const real epsilon = LIMIT(EPSILON);
#define ALIGNED(memory) ((void *)(((size_t)(memory) + 63) & ~(size_t)63))

#if GS_FIXED_POINT
/* Functions of the fixed-point iteration: of one trajectory, and of a batch of trajectories. */
#if GS_SPARK
#define SINGLE(f) single_##f
#define BATCH(f) batch_##f
#else
#define SINGLE(f) midpoint_##f
#define BATCH(f) midpoint_##f
#endif
#endif

#endif
