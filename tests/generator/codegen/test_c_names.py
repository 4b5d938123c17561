"""Names of symbols in C: what is refused breaks it, what is accepted compiles and runs."""

import re
from functools import cache
from itertools import product

import cffi
import numpy as np
import pytest
import sympy as sp
from cffi.commontypes import COMMON_TYPES

import gyrospark as gs
from compilers import ALL_ERRORS, COMPILERS
from gyrospark.core.errors import InputError
from gyrospark.generator.parsing.reserved_names import KEYWORDS, is_taken
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from processes import ROOT, call

#: Macros without arguments of the engine, which any stepper may have.
ENGINE_MACROS = {"GYROSPARK_PLAIN", "GYROSPARK_OBJECT"}.union(*(
    re.findall(r"^ *# *define ([A-Za-z]\w*)(?=\s)", path.read_text(encoding="utf-8"), re.MULTILINE)
    for path in (*(ROOT / "templates").glob("*.jinja"), *(ROOT / "engine").rglob("*.h"))))
HEADERS = """\
#include <errno.h>
#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
""" + "".join(f"#define {name} 1\n" for name in sorted(ENGINE_MACROS))
EDITIONS = ["c11", "gnu17", "c2x", "gnu2x"]
KEYWORDS_OF_C23 = {
    "alignas", "alignof", "bool", "constexpr", "false", "nullptr", "static_assert",
    "thread_local", "true", "typeof", "typeof_unqual",
}
HANDPICKED = [
    "NULL", "NAN", "INFINITY", "HUGE_VAL", "HUGE_VALF", "M_PI", "M_E", "DBL_MAX", "FLT_EPSILON",
    "LDBL_MIN", "FP_NAN", "linux", "unix", "I", "J", "i", "j", "pi", "e", "gamma", "none",
    "complex", "imaginary", "near", "far", "min", "max", "isnan", "isfinite", "signbit", "fabs",
    "real", "constants", "parameters_t", "work_t", "k0", "k1", "t0", "u0", "sum", "c", "w", "M_1",
    "M_body", "FLT", "DBL_", "OK", "N", "M", "S", "P", "U", "class", "new", "PENDULUM_H",
    "ODD_GL1_H", "ODD_EMS_H",
]
q, p = sp.symbols("q p", real=True)


def macros(folder):
    """Return the macros without arguments that each compiler sees after the headers."""
    (folder / "headers.c").write_text(HEADERS, encoding="utf-8")
    names = set()
    for command in COMPILERS.values():
        for edition in EDITIONS:
            listed = call([*command, f"-std={edition}", "-dM", "-E", "headers.c"],
                          cwd=folder).stdout
            names |= set(re.findall(r"^#define ([A-Za-z]\w*) ", listed, re.MULTILINE))
    return names


@pytest.fixture(scope="module")
def suspicious(tmp_path_factory):
    """Return keywords, macros, cffi's types, and every word of the templates and headers."""
    texts = [*(ROOT / "templates").glob("*.jinja"), *(ROOT / "engine").rglob("*.h")]
    words = {word for path in texts
             for word in re.findall(r"\b[A-Za-z]\w*", path.read_text(encoding="utf-8"))}
    assert "satisfies_constraints" in words  # of a header
    defined = macros(tmp_path_factory.mktemp("macros"))
    return sorted({*KEYWORDS, *defined, *COMMON_TYPES, *words, *HANDPICKED, *ENGINE_MACROS})


def odd_system(names):
    symbols = tuple(sp.Symbol(name, real=True) for name in names)
    kinetic = p**2 * sp.sqrt(1 + sp.Add(*(s**2 for s in symbols))) / 2  # read by ``prepare``
    H = kinetic + sp.Add(*(s * q**2 for s in symbols)) / 2  # read by the kernels
    return gs.System((q,), (p,), symbols, H, name="odd")


@cache
def stepper_of(scheme, stages, names):
    return gs.stepper(scheme, stages, system=odd_system(names))


def is_accepted(name):
    try:
        return bool(odd_system([name]))
    except InputError:
        return False


@pytest.fixture(scope="module")
def accepted(suspicious):
    """Return the names picked by hand, and one of thirty of the suspicious names."""
    sample = {*HANDPICKED, *suspicious[::30], "size_t"} - {"p", "q"}
    return [name for name in sorted(sample) if is_accepted(name)]


@pytest.mark.slow  # systems of thousands of parameters take half a minute to derive
@pytest.mark.parametrize(("scheme", "stages"), [("G-L", 1), ("EMS", None)])
def test_every_accepted_name_compiles_and_runs(scheme, stages, suspicious):
    compiles_and_runs(scheme, stages, [name for name in suspicious if name not in ("p", "q")
                                       and is_accepted(name)])


def test_accepted_names_compile_and_run(accepted):
    compiles_and_runs("G-L", 1, accepted)


def compiles_and_runs(scheme, stages, accepted):
    assert {"I", "none", "real", "constants", "isnan", "N", "OK", "k0", "size_t"} <= set(accepted)
    values = {name: (i % 7) / 100 for i, name in enumerate(accepted)}
    step = stepper_of(scheme, stages, tuple(accepted))
    run = step.integrate([1.0], [0.0], dt=1e-3, steps=500, parameters=values)
    stiffness = sum(values.values())
    inverse_mass = np.sqrt(1 + sum(value**2 for value in values.values()))
    energy = run.p[:, 0] ** 2 * inverse_mass / 2 + run.q[:, 0] ** 2 * stiffness / 2
    np.testing.assert_allclose(run.energy(), energy, rtol=1e-13)
    np.testing.assert_allclose(
        run.q[-1], np.cos(np.sqrt(inverse_mass * stiffness) * 0.5), rtol=0, atol=1e-3)


def test_accepted_names_suit_every_edition_of_c(accepted, tmp_path):
    stepper = stepper_of("G-L", 1, tuple(accepted))
    for name, text in stepper.files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    for command, edition in product(COMPILERS.values(), EDITIONS):
        done = call([*command, f"-std={edition}", "-fsyntax-only", f"{stepper.name}.c"],
                    cwd=tmp_path)
        assert done.returncode == 0, done.stderr


def broken(names, folder):
    """Return the names that no member of a struct can have, in one edition of C at least."""
    members = "".join(f'typedef struct {{\n#line {i} "N"\ndouble {name};\n}} s{i};\n'
                      for i, name in enumerate(names, 1))
    (folder / "members.c").write_text(HEADERS + members, encoding="utf-8")
    unusable = {name for name in names if not is_readable(name)}
    for kind, command in COMPILERS.items():
        for edition in EDITIONS:
            errors = call([*command, f"-std={edition}", "-fsyntax-only", "-w", *ALL_ERRORS[kind],
                           "members.c"], cwd=folder).stderr
            unusable |= {names[int(line) - 1]
                         for line in re.findall(r"^N:(\d+):\d+: error", errors, re.MULTILINE)}
    return unusable


def is_readable(name):
    """Return whether cffi takes a declaration with this name."""
    try:
        ffi = cffi.FFI()
        ffi.cdef(f"typedef struct {{ double {name}; }} s;")
        return [field for field, _ in ffi.typeof("s").fields] == [name]
    except (cffi.CDefError, cffi.FFIError):
        return False


def test_every_refused_name_breaks_the_c(suspicious, tmp_path):
    """The keywords of C23, which older compilers do not know, are the only exceptions."""
    names = [name for name in suspicious if is_taken(name)]
    assert len(names) > 100
    assert set(names) - broken(names, tmp_path) <= KEYWORDS_OF_C23


@pytest.mark.parametrize("name", ["NAN", "M_PI", "M_PI_4f", "DBL_MAX", "bool", "PENDULUM_GL2_H",
                                  "errno", "EOF", "EIO", "EDEADLK", "EOPNOTSUPP"])
def test_refused_name_is_named_with_the_cure(name):
    x, px, odd = sp.symbols(f"x px {name}", real=True)
    with pytest.raises(InputError, match=f"'pendulum'.*'{name}'.*keyword"):
        gs.System((x,), (px,), (odd,), px**2 / 2, name="pendulum")


def test_include_guard_of_a_header_is_refused_because_it_would_vanish():
    source = generate(Spec("G-L", 1), system=odd_system(["k"])).source
    assert f"#define {source.name.upper()}_H" in source.files()[f"{source.name}.h"]
    with pytest.raises(InputError, match="another name"):
        odd_system([f"{source.name.upper()}_H"])
