"""AddressSanitizer and UndefinedBehaviorSanitizer below a plain C program that calls a stepper.

The program (``tests/data/sanitized.c``) gives each call memory of the size that its header
documents: runs, ensembles in lanes, projections, tangents and adjoints. Another one
(``tests/data/sanitized_fmu.c``) imports an FMU.
"""

import json
import os
import re
import shutil
import zipfile
from functools import cache

import pytest

import gyrospark as gs
import systems
from c_programs import run, write
from compilers import COMPILERS, compiler
from gyrospark.engine.amalgamate import FOLDER
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from processes import DATA, call

SANITIZE = ["-g1", "-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]

#: Name → stepper, system of the catalogue, with derivatives or not.
STEPPERS = {
    "derivatives": (Spec("G-L", 2), "pendulum", True),
    "rolling": (Spec("G-L", 2), "sleigh", False),
    "splitting": (Spec.from_arguments("splitting", order=2), "heavy_top", True),
    "frame": (Spec("G-L", 2).with_frame("symmetries"), "heavy_top_in_frame", True),
    "discrete gradient": (Spec("EMS"), "two_rods", False),
    "its derivatives": (Spec("EMS"), "two_rods", True),
}


@cache
def sanitizing():
    """Return a compiler with both sanitizers; skip without one."""
    for kind in COMPILERS:
        empty = ["-shared", "-x", "c", os.devnull, "-o", os.devnull]  # links the sanitizers
        if call([*compiler(kind), *SANITIZE, *empty]).returncode == 0:
            return compiler(kind)
    return pytest.skip("no compiler here has AddressSanitizer")


def write_case(name, folder):
    """Write a stepper, and the facts that the program needs of it."""
    spec, system, derivatives = STEPPERS[name]
    case = systems.case(system)
    source = generate(spec, system=case.options.get("system"), derivatives=derivatives).source
    write(source.files(standalone=False), folder)
    fields = re.search(rf"typedef struct {{([^}}]*)}} {source.name}_parameters;", source.header)[1]
    names = re.findall(r"double (\w+);", fields)
    values = dict.fromkeys(names, case.t0) | dict(case.parameters)

    def size(pattern, default=0):
        macro = re.search(pattern, source.header)
        return int(macro[1]) if macro else default

    about = json.loads(source.manifest)
    constraints = about["system"]["constraints"]
    sizes = {
        "NAME": source.name, "N": len(about["system"]["coordinates"]), "DT": case.dt,
        "MULTIPLIERS": size(r"multipliers\[(\d+)\]"), "UNKNOWNS": size(r"_keep\([^)]*x\[(\d+)\]"),
        "Z": size(r"start time, (\d+) in all"), "DERIVATIVES": int(derivatives),
        "LANES": int("_batch;" in source.header), "SOLVERS": 1 if spec.scheme == "splitting" else 3,
        "CONSTRAINTS": len(constraints),
        "HIDDEN": len(constraints) + len(about["system"].get("velocity_constraints", ())),
        "PARAMETERS": f"{{{', '.join(repr(float(values[field])) for field in names)}}}"}
    lines = [f'#include "{source.name}.h"', *(f"#define {key} {x}" for key, x in sizes.items())]
    for key, state in (("q", case.q), ("p", case.p)):
        entries = ", ".join(repr(float(x)) for x in state)
        lines.append(f"static const double start_{key}[N] = {{{entries}}};")
    (folder / "case.h").write_text("\n".join(lines) + "\n", encoding="ascii")
    shutil.copy(DATA / "sanitized.c", folder)
    return source.name


def build(name, folder):
    stepper = write_case(name, folder)
    run([*sanitizing(), *SANITIZE, "-std=c11", f"-I{FOLDER}", "sanitized.c", f"{stepper}.c",
         "-o", "program", "-lm"], folder)


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name != "discrete gradient"))  # 2 s to compile
    for name in STEPPERS])
def test_nothing_is_read_or_written_outside_of_its_array(name, tmp_path):
    build(name, tmp_path)
    process = call([tmp_path / "program"])
    assert process.returncode == 0, process.stderr[:3000]


def fmu_program(folder):
    """Return a program that imports an FMU of the driven oscillator."""
    case = systems.case("driven_oscillator")
    artefact = gs.build("fmu2", case.system, scheme="IMS", dt=case.dt, start=(case.q, case.p),
                        parameters=case.parameters, out=folder / "driven.fmu")
    with zipfile.ZipFile(artefact.path) as archive:
        for name in archive.namelist():
            if name.startswith("sources/"):
                (folder / name.partition("/")[2]).write_bytes(archive.read(name))
    shutil.copy(DATA / "sanitized_fmu.c", folder)
    run([*sanitizing(), *SANITIZE, "-std=c11", f"-DSTEP={case.dt}", "sanitized_fmu.c",
         f"{artefact.stepper.name}.c", "-o", "program", "-lm"], folder)
    return folder / "program"


def test_an_fmu_reads_and_writes_nothing_outside_of_its_arrays(tmp_path):
    process = call([fmu_program(tmp_path)])
    assert process.returncode == 0, process.stderr[:3000]
