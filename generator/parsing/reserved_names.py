"""Keywords and macros of C, which no struct member can be named."""

from __future__ import annotations

import errno
import re

__all__ = ["KEYWORDS", "is_taken"]

#: Keywords of C11 and C23, of C compilers (asm) and of cffi's parser of C (the last two).
KEYWORDS = frozenset(
    ["auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else",
     "enum", "extern", "float", "for", "goto", "if", "inline", "int", "long", "register",
     "restrict", "return", "short", "signed", "sizeof", "static", "struct", "switch", "typedef",
     "union", "unsigned", "void", "volatile", "while", "alignas", "alignof", "bool", "constexpr",
     "false", "nullptr", "static_assert", "thread_local", "true", "typeof", "typeof_unqual", "asm",
     "offsetof", "WINAPI"]
)

#: Macros without arguments that <float.h>, <math.h>, <stddef.h> and <stdio.h> define or reserve in
#: any edition of C, macros of the engine, and macros that compilers predefine. <Python.h>, which
#: the module of a stepper includes, includes <stdio.h> and <errno.h>.
_MACRO = re.compile(
    r"""
    NULL | NAN | INFINITY | HUGE | HUGE_VAL\w* | SNAN\w* | MAXFLOAT | DECIMAL_DIG
    | GYROSPARK_PLAIN | GYROSPARK_OBJECT | GS_\w+ | INLINE(_IF_SMALL)? | NOINLINE
    | lanes_(broadcast | mask_not | select_(mask | quadrant | value))
    | LANE_BYTES | LANES_(ELSEWHERE | ONCE) | NUMBERS_ELSEWHERE | NUMBER | ONCE | TIMES | PRODUCT
    | TABLE_PRODUCT | COEFFICIENT | RELOAD_STATE
    | ((ACCURATE | DEFECT | (ERROR_)?FLOOR | POOR | (STAGE_)?RIDGE)_UNITS)
    | (DERIVATIVE | REMAINDER | ROUND_OFF | UNDERFLOW)_MARGIN | (CANDIDATE | POLYNOMIAL)_GAIN
    | (EFFORT | RATE)_MEMORY | (FIRST | MAX)_RETRY | ((FITTED_)?TRIAL | INITIAL_RATE)_STEPS
    | (FLOOR | REFIT)_FACTOR | (MIN | SLOW)_RATE | (STALLED | SWITCH)_RATIO
    | DEFECT_(ALLOWANCE | FLOOR | PROGRESS) | MAX_(BACKOFF | CHANGE | (DEFECT_)?STAGNATION)
    | CYCLE_END | DEGRADATION | FAR_CHANGE | FLOOR_OVERESTIMATE | LATE_FIT | NEWTON_RESIDUALS
    | MOST_DERIVATIVE_ITERATIONS | OVERDETERMINATION | RATE_STRIDE | REFIT_(GROWTH_END | INTERVAL)
    | SHORT_STEP_ITERATIONS
    | errno | EOF | BUFSIZ | (FILENAME | FOPEN | TMP)_MAX | SEEK_(CUR | END | SET | DATA | HOLE)
    | L_(ctermid | tmpnam) | P_tmpdir
    | math_errhandling | linux | unix | i386
    | (FLT | DBL | LDBL | DEC[0-9]* | FP | MATH)_[A-Z0-9_]+
    | M_(E | LOG2E | LOG10E | LN2 | LN10 | PI | PI_2 | PI_4 | 1_PI | 2_PI | 2_SQRTPI | SQRT2
        | SQRT1_2)(f | l | f[0-9]+x?)?
    """,
    re.VERBOSE,
)

#: Macros of <errno.h>, of which Python knows all but one; ``errno.errorcode`` has one a number.
_ERRORS = frozenset(["EHWPOISON", *(name for name in vars(errno) if name.startswith("E"))])


def is_taken(name: str) -> bool:
    """Whether a name is a keyword of C or a macro that the generated C sees."""
    return name in KEYWORDS or name in _ERRORS or _MACRO.fullmatch(name) is not None
