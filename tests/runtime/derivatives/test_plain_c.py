"""Derivatives in plain C: profile run with --derivatives, beside Python."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
import systems
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from processes import call
from toy import FLAGS

PROGRAM = r"""
#include <stdio.h>
#include <stdlib.h>
#define {NAME}_WORK
#include "{name}.h"

enum {{ STEPS = {steps}, N = 4, U = {unknowns}, ROWS = 2*N + 5 + 2 }};
int main(void)
{{
    const {name}_parameters top = {{ 0.002, 0.002, 0.0008, 0.3924, 0.0016 }};
    const {name}_options options = {{ 0, 50, {solver} }};
    static {name}_work work;
    static double q[STEPS + 1][N] = {{ {{ {q} }} }}, p[STEPS + 1][N] = {{ {{ {p} }} }}, x[STEPS][U];
    double w[2*N] = {{ 1, 2, 3, 4 }}, z[ROWS] = {{ 0 }};
    {name}_begin(&work, &top, &options, 1e-3, q[0], p[0]);
    for (int j = 0; j < STEPS; ++j) {{
        for (int a = 0; a < N; ++a) {{
            q[j + 1][a] = q[j][a];
            p[j + 1][a] = p[j][a];
        }}
        if ({name}_advance(&work, 1, q[j + 1], p[j + 1]))
            return 1;
        {name}_keep(&work, &options, x[j]);
    }}
    void *memory = malloc({name}_derivative_size());
    if ({name}_integrate_adjoint(&top, 1e-3, 0, STEPS, q[0], p[0], x[0], NULL, 1, NULL, w, z,
                                 memory))
        return 2;
    for (int e = 2*N; e < ROWS; ++e)
        printf("%.17g\n", z[e]);
    free(memory);
    return 0;
}}
"""


@pytest.mark.parametrize(("scheme", "options", "solver"), [
    ("G-L", {"stages": 2}, 1),
    pytest.param("splitting", {"order": 4}, 0, marks=pytest.mark.slow)])
def test_a_program_in_c_has_the_gradient_of_python(tmp_path, scheme, options, solver):
    code = generate(Spec.from_arguments(scheme, **options).with_profile("run"), derivatives=True)
    name, problem, steps = code.source.name, gs.problems.fast_top(), 20
    for file, text in code.source.files().items():
        (tmp_path / file).write_text(text)
    (tmp_path / "main.c").write_text(PROGRAM.format(
        NAME=name.upper(), name=name, steps=steps, solver=solver, unknowns=max(code.scheme.size, 1),
        q=", ".join(map(repr, map(float, problem.q0))),
        p=", ".join(map(repr, map(float, problem.p0)))))
    warnings = [flag for flag in FLAGS if flag.startswith(("-std", "-W")) and "unused" not in flag]
    done = call(["cc", *warnings, "-Werror", "-O0", "main.c", f"{name}.c", "-lm", "-o", "program"],
                cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    printed = np.array(call([tmp_path / "program"]).stdout.split(), float)
    step = systems.differentiable("heavy_top") if scheme == "G-L" else gs.stepper(scheme, **options)
    run = step.integrate(problem.q0, problem.p0, dt=1e-3, steps=steps,
                         parameters=problem.parameters | {"gamma": 0.0016})
    gradient = run.gradient({"q": [1.0, 2.0, 3.0, 4.0]})
    expected = [gradient[key] for key in ("I1", "I2", "I3", "mgl", "gamma", "dt")]
    assert np.abs(printed[:-1] - expected).max() <= 1e-10 * np.abs(expected).max()
