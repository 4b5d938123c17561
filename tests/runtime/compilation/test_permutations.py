"""A 512-bit permutation that gcc gets wrong: objects with it are compiled again without."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

import gyrospark as gs
from compilers import compiler
from gyrospark.generator.systems.numeric_system import numeric
from gyrospark.runtime.compilation import compiler as build
from gyrospark.runtime.compilation.object_files import WITHOUT_PERMUTATIONS, has_permutation

#: A link on a hinge: 21 constants of its last constraint are gathered eight at a time.
HINGE = """<robot name="hinge"><link name="base"/>
  <link name="link"><inertial>
    <origin xyz="0.04 0.12 0.16" rpy="0.4 -0.6 1.0"/><mass value="1.9"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.06"/>
  </inertial></link>
  <joint name="hinge" type="revolute"><origin xyz="0.1 0 0.5" rpy="0 1.1 0"/>
    <parent link="base"/><child link="link"/><axis xyz="-0.6 0.05 1.75"/>
    <limit lower="-2" upper="2" effort="10" velocity="5"/></joint>
</robot>
"""
#: Four of eight elements that are in a register: right it returns 12, wrong 4.
FOUR_OF_EIGHT = """
typedef double eight __attribute__((vector_size(64)));
typedef double four __attribute__((vector_size(32)));
__attribute__((noinline)) static four some(const eight *x)
{
    const eight y = *x + *x;
    return (four){ y[1], y[1], y[2], y[6] };
}
int main(void)
{
    volatile eight x = { 0, 1, 2, 3, 4, 5, 6, 7 };
    const eight y = x;
    return (int)some(&y)[3];
}
"""
FEATURES = Path("/proc/cpuinfo")


def with_avx512():
    return FEATURES.exists() and " avx512vl " in FEATURES.read_text(encoding="utf-8")


def compiled(folder, *flags):
    """Return the program of four of eight and its machine code."""
    source, program = folder / "four.c", folder / "four"
    source.write_text(FOUR_OF_EIGHT, encoding="utf-8")
    result = subprocess.run([*compiler("gcc"), "-O2", "-w", "-march=skylake-avx512", *flags, source,
                             "-o", program], capture_output=True, text=True, check=False)
    if result.returncode:
        pytest.skip(f"this gcc knows no AVX-512: {result.stderr.strip()}")
    return program, program.read_bytes()


def test_the_instruction_is_found_and_the_flags_avoid_it(tmp_path):
    _, code = compiled(tmp_path)
    if not has_permutation(code):
        pytest.skip("this gcc permutes eight doubles another way")
    for flags in WITHOUT_PERMUTATIONS:
        program, code = compiled(tmp_path, *flags)
        assert not has_permutation(code), flags
        if with_avx512():
            assert subprocess.run([program], check=False).returncode == 12, flags


def test_warnings_of_a_second_compilation_are_no_errors(tmp_path, monkeypatch):
    """Avoiding the instruction by flags makes gcc doubt what it knew to be initialised."""
    compiler("gcc")
    monkeypatch.setattr(build, "has_permutation", lambda code: b"doubted" in code)
    (tmp_path / "a.c").write_text(
        "int doubted(int x);\nint doubted(int x)\n{\n    int y;\n    if (x)\n        y = 1;\n"
        "    return y;\n}\n", encoding="utf-8")
    command = ["gcc", "-O1", "-Wall", "-Werror", "-c", "a.c", "-o", "a.o"]
    (tmp_path / "a.o").write_bytes(b"doubted")
    build._replace_permutations([command], tmp_path)
    assert (tmp_path / "a.o").read_bytes() != b"doubted"


@pytest.mark.parametrize(("code", "expected"), [
    ("62 f3 fd 48 05 c0 a3", True),       # vpermilpd $163, %zmm0, %zmm0
    ("62 03 fd 48 05 ff a3", True),       # vpermilpd $163, %zmm31, %zmm31
    ("62 f3 fd 48 05 44 24 01 a3", True),  # vpermilpd $163, 64(%rsp), %zmm0
    ("62 f3 fd 58 05 07 a3", True),       # vpermilpd $163, (%rdi){1to8}, %zmm0
    ("62 f3 fd 28 05 c0 0a", False),      # of 256 bits, which gcc gets right
    ("c4 e3 7d 05 c0 0a", False),         # the same without EVEX
    ("62 f3 fd 48 01 c0 a3", False),      # vpermpd, which moves across pairs
    ("62 f3 7d 48 04 c0 a3", False),      # vpermilps
])
def test_encodings(code, expected):
    assert has_permutation(b"\x90" + bytes.fromhex(code) + b"\xc3") is expected


@pytest.mark.slow  # six seconds with all optimisation
def test_constraints_of_a_hinge_at_full_optimisation(tmp_path, monkeypatch):
    """g has the values of the system's formulas in NumPy, at random states near a start."""
    if not with_avx512():
        pytest.skip("this machine has no AVX-512")
    if not build.find_compiler().is_gcc:
        pytest.skip("the compiler is not gcc")
    monkeypatch.setenv("GYROSPARK_OPTIMISE", "3")
    path = tmp_path / "hinge.urdf"
    path.write_text(HINGE, encoding="utf-8")
    model = gs.load_model(path, ignore="limits")
    step = gs.stepper("G-L", 1, system=model)
    formulas = numeric(model.system, model.parameters)
    for move in np.random.default_rng(1).normal(size=(20, step.n)):
        q = model.q0 + 0.1 * move
        g, _ = step.defects(q, model.p0, parameters=model.parameters)
        assert np.abs(g - formulas.g(q)).max() <= 1e-14
