"""Programs of users around artefacts: a class that is copied, bad input, an emulated board."""

from __future__ import annotations

import re
import shutil
import sys

import numpy as np
import pytest

import gyrospark as gs
from c_programs import run
from compilers import COMPILERS_OF_CPLUSPLUS, MAIN, compiler
from gyrospark.targets.native import C_FLAGS
from gyrospark.targets.tools import TOOLS
from processes import ROOT, call

SATELLITE = ROOT / "examples" / "control_c" / "satellite.toml"
NAME = "wheeled_satellite_gl2_gamma"

USER = r"""
#include "wheeled_satellite_gl2_gamma.hpp"
#include <cstdio>

static void print(const WheeledSatellite &at)
{
    for (double x : at.q)
        std::printf("%a ", x);
    std::printf("%d\n", int(at.status()));
}

int main()
{
    WheeledSatellite satellite;
    for (int k = 0; k < 10; ++k)
        satellite.advance();
    const WheeledSatellite stored = satellite;
    for (int k = 0; k < 10; ++k)
        satellite.advance();
    print(satellite);
    satellite = stored;
    for (int k = 0; k < 10; ++k)
        satellite.advance();
    print(satellite);

    auto parameters = satellite.parameters();
    parameters.I1 = -1;
    std::printf("%d %g %g\n", int(satellite.set_parameters(parameters)),
        satellite.parameters().I1, double(satellite.time()));
    for (double x : satellite.quantities())
        std::printf("%.17g ", x);
    std::printf("\n%d %d\n", int(WheeledSatellite(0.0).status()),
        int(satellite.begin(0.1, {}, WheeledSatellite::model_p)));

    WheeledSatellite other;
    const auto velocity = other.velocity();
    std::printf("%d", int(other.start(0.1, WheeledSatellite::model_q, velocity)));
    for (double x : other.p)
        std::printf(" %.17g", x);
    std::printf(" %.17g\n", other.energy());
}
"""


def test_a_class_by_value(tmp_path):
    """A copy is a saved state; an unusable value changes nothing and says so."""
    plusplus = compiler(MAIN, COMPILERS_OF_CPLUSPLUS)
    artefact = gs.build("cpp", SATELLITE, scheme="G-L", stages=2, out=tmp_path / "made")
    (artefact.path / "user.cpp").write_text(USER, encoding="utf-8")
    run([*compiler(MAIN), *C_FLAGS, "-c", f"{NAME}.c"], artefact.path)
    run([*plusplus, "-std=c++17", "-Wall", "-Wextra", "-pedantic", "-Werror", "user.cpp",
         f"{NAME}.o", "-lm", "-o", "user"], artefact.path)
    original, copied, refused, quantities, unusable, started = run(
        [artefact.path / "user"], artefact.path).splitlines()
    assert original == copied
    assert original.endswith(" 0")
    assert refused.split() == ["6", "12", "2"]
    assert unusable.split() == ["6", "6"]
    step = gs.stepper("G-L", 2, system=gs.load_model(SATELLITE))
    trajectory = step.integrate(artefact.options.q, artefact.options.p, dt=0.1, steps=20,
                                parameters=dict(artefact.options.parameters))
    q = [float.fromhex(x) for x in original.split()[:4]]
    np.testing.assert_allclose(q, trajectory.q[-1], rtol=0, atol=1e-13)
    np.testing.assert_allclose([float(x) for x in quantities.split()],
                               trajectory.quantity_values[-1], rtol=0, atol=1e-13)
    status, *p, energy = map(float, started.split())
    assert status == 0
    np.testing.assert_allclose(p, artefact.options.p, rtol=0, atol=1e-15)
    assert energy == pytest.approx(trajectory.energies[0], rel=1e-14)


PAGE = (ROOT / "docs" / "build.md").read_text(encoding="utf-8")
#: Headings of the page, and what is typed under them.
TYPED = re.findall(r"^## (.*?)\n.*?^```sh\n(.*?)^```", PAGE, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.slow
@pytest.mark.parametrize(("title", "block"), TYPED, ids=[title for title, _ in TYPED])
def test_commands_of_the_page(tmp_path, title, block):
    """The commands of a section, as they are typed, build its artefact."""
    for program in ("cmake", "cargo", "octave", "cc"):
        if re.search(rf"\b{program} ", block) and shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    run(["bash", "-ec", f"gyrospark() {{ {sys.executable} -m gyrospark \"$@\"; }}\n"
         f"exec 2>&1\n{block}"], tmp_path)


def test_octave_refuses_in_sentences(tmp_path):
    octave = TOOLS["octave"].find()
    if octave is None or TOOLS["mkoctfile"].find() is None:
        pytest.skip("Octave is not installed")
    artefact = gs.build("octave", SATELLITE, scheme="G-L", stages=2, out=tmp_path / "made")
    calls = ("1, 10.5", "0.1, 10, [], [1 2]", '0.1, 10, [], [], [], struct("I4", 2)', "0, 10",
             "0.1, 10, 1, [], [], 3", "0.1, 10, 1, [], [], [], ones(3, 9)",
             "0.1, 3, 1, [], [], [], [0 0 0; 0 NaN 0; 0 0 0]", "1, 2, 3, 4, 5, 6, 7, 8", "1i, 10",
             "0.1, 5, 1, [], [], [], ones(5, 3)", "0.1, 5, 1, sparse([1 0 0 0])",
             "0.1, 5, 1, [2 0 0 0]")
    lines = [f"try, {NAME}({call_arguments}); disp('taken'), catch e, disp(e.message), end\n"
             for call_arguments in calls]
    inputs = (f"a = {NAME}(0.1, 5, 1, [], [], struct('u2', 0.3));\n"
              f"b = {NAME}(0.1, 5, 1, [], [], [], [0 0.3 0]'*ones(1, 5));\n"
              "[q, p, iterations, energy] = "
              f"{NAME}(0.1, 4, 2); disp(isequal(a, b)), disp(size(b)), disp(size(energy))\n"
              f"printf('%.17g ', energy)\n")
    (artefact.path / "user.m").write_text("".join(lines) + inputs, encoding="utf-8")
    output = call([*octave, "--no-gui", "--norc", "--quiet", "user.m"], cwd=artefact.path)
    *refusals, is_equal, size, of_energy, energies = output.stdout.splitlines()
    for words, refusal in zip(("10.5", "4 real", "I4.*I1", "dt", "struct", "inputs",
                               "step 2", "8 arg", "dt", "5 rows; give 3", "q0.*sparse",
                               "q0.*2 0 0 0.*length 2"), refusals, strict=True):
        assert re.search(words, refusal), refusal
        assert refusal.endswith(".")
    assert is_equal.strip() == "1"
    assert (size.split(), of_energy.split()) == (["4", "6"], ["1", "3"])
    step = gs.stepper("G-L", 2, system=gs.load_model(SATELLITE))
    trajectory = step.integrate(artefact.options.q, artefact.options.p, dt=0.1, steps=4, every=2,
                                parameters=dict(artefact.options.parameters))
    np.testing.assert_allclose([float(x) for x in energies.split()], trajectory.energies,
                               rtol=1e-13)


@pytest.mark.slow  # Octave compiles twice
def test_octave_compiles_what_was_built_again_and_says_where_steps_are_less_exact(tmp_path):
    octave = TOOLS["octave"].find()
    if octave is None or TOOLS["mkoctfile"].find() is None:
        pytest.skip("Octave is not installed")

    def built(**parameters):
        return gs.build("octave", SATELLITE, scheme="G-L", stages=2, out=tmp_path / "made",
                        parameters=parameters)

    def last(arguments):
        return call([*octave, "--no-gui", "--norc", "--quiet", "--eval",
                     f"printf('%.17g', {NAME}({arguments})(1, end))"], cwd=tmp_path / "made")

    heavy = 'struct("I1", 20)'
    built()
    first, heavy_run = last("0.1, 500"), last(f"0.1, 500, 1, [], [], {heavy}")
    built(I1=20.0)
    rebuilt = last("0.1, 500")
    assert float(first.stdout) < 0.07
    # the start is projected again, which 500 steps amplify
    assert float(rebuilt.stdout) == pytest.approx(float(heavy_run.stdout), rel=1e-10)
    assert "converge" not in rebuilt.stderr
    assert "converge" in last("40, 3").stderr
