"""Constants of a run that loops evaluate: the same numbers as one assignment for each."""

import re

import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.generator.codegen import constant_loops, emit
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.runtime.compilation.kernel_text import kernels_of


def masses():
    """Return twelve anharmonic oscillators with constants 1/m and k/m."""
    x, p, m, k = (sp.symbols(f"{name}0:12", positive=True) for name in "xpmk")
    H = sum(b**2 / (2 * c) + d / c * a**4 for a, b, c, d in zip(x, p, m, k, strict=True))
    return gs.System(x, p, (*m, *k), H, name="masses")


def sources_of(system, monkeypatch):
    """Return the name of a stepper, and its files with single assignments and with loops."""
    spec, sources = Spec.from_arguments("IMS"), []
    for few in (64, 3):
        monkeypatch.setattr(constant_loops, "_FEW", few)
        monkeypatch.setattr(emit, "_LARGE", 4 * few)
        sources.append(generate(spec, system=system).source)
    return sources[0].name, *(source.files() for source in sources)


def test_rows_of_a_loop_name_the_parameters_of_their_constants():
    """Written out row by row, loops and single assignments are the constants again."""
    constants = {f"k{i}": f"par->a{i}*par->b{i} - 2*par->a{i}" for i in range(70)}
    constants |= {"single": "par->a0/par->b0"} | {f"c{i}": f"1/par->c{i}" for i in range(64)}
    assigned, loops = constant_loops.split_constants(constants)
    assert [len(loop.rows) for loop in loops] == [70, 64]
    texts = dict(assigned)
    for loop in loops:
        for index, names in loop.rows:
            row = [index, *names]
            texts[index] = re.sub(rf"parameter_at\(par, {loop.name}\[i\]\[(\d+)\]\)",
                                  lambda match, row=row: f"par->{row[int(match[1])]}", loop.formula)
    assert [texts[index] for index in range(len(constants))] == [*constants.values()]


@pytest.mark.parametrize("system", [masses, pytest.param(
    lambda: gs.models.chain(2).system, marks=pytest.mark.slow, id="chain")])  # derived twice
def test_loops_have_the_constants_of_single_assignments(system, monkeypatch):
    """The first kernels that ``kernels_of`` reads from both agree, statement by statement."""
    stem, single, looped = sources_of(system(), monkeypatch)
    name = f"{stem}.c"
    assert "parameter_at" not in single[name]
    assert looped[name].count("parameter_at(par, ") >= 2
    assert ["#define INLINE_IF_SMALL NOINLINE" in files[name] for files in (single, looped)] == [
        False, True]

    single_kernel, looped_kernel = (kernels_of(files[name])[0] for files in (single, looped))
    assert single_kernel.name == looped_kernel.name == "prepare"
    assert sorted(map(repr, single_kernel.statements)) == sorted(
        map(repr, looped_kernel.statements))
    assert {*single_kernel.outputs} == {*looped_kernel.outputs}
    assert len(single_kernel.outputs) > 12
