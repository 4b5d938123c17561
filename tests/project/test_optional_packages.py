"""The package works with few packages: no part needs one that happens to be installed.

Optional ones are hidden from processes of their own; a call that needs one says so before it
computes.
"""

from __future__ import annotations

import json

import pytest

from gyrospark.core.extras import install
from processes import FAST_TOP, python
from sweep_studies import STUDY, study_file

OPTIONAL = ["dask", "distributed", "h5netcdf", "h5py", "matplotlib"]
#: Packages that write stores.
STORES = ["filelock", "xarray", "zarr"]
COMMANDS = """
import contextlib, io, json
from gyrospark.commands import main

def command(text):
    sys.argv, out, err = ["gyrospark", *text.split()], io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as end:
            return end.code, out.getvalue(), err.getvalue()

RUN = "run fast-top --scheme EMS --dt 1e-3 --steps 20 "
"""


def without(packages):
    """Return code after which some packages cannot be imported."""
    return f"import sys\nsys.modules.update(dict.fromkeys({packages}))\n"


@pytest.mark.slow  # ten commands with their stores
def test_commands(tmp_path):
    """Each command ends well; no folder has a hidden file afterwards."""
    study_file(tmp_path, STUDY.replace("count = 40", "count = 4").replace("count = 32",
                                                                         "count = 3"))
    answers = json.loads(python(without(OPTIONAL) + COMMANDS + """
print(json.dumps({text: command(text) for text in (
    RUN, RUN + "--out a.csv", RUN + "--out a.npz", RUN + "--out a.zarr",
    "export a.zarr b.csv", "export a.zarr b.npz", "sweep study.toml", "verify --scheme EMS",
    "reproduce table-2", "cache list")}))
""", cwd=tmp_path))
    for text, (code, _, stderr) in answers.items():
        assert (code, stderr) == (0, ""), text
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert {path.name for path in tmp_path.iterdir()} == {
        "study.toml", "a.csv", "a.npz", "a.zarr", ".a.zarr.lock", "b.csv", "b.npz", "study.zarr",
        ".study.zarr.lock"}


def test_csv_needs_no_store(tmp_path, gyrospark):
    """Where no store can be written, CSV comes from memory, and is the same.

    To look at names of the extra is no error; to call them, and the command, is one.
    """
    lines = python(without([*OPTIONAL, *STORES]) + COMMANDS + """
answer = command(RUN + "--every 3 --out a.csv")
assert answer[0] == 0 and not answer[2], answer
from gyrospark import *
import gyrospark as gs
for name, arguments in (("resume", ("x",)), ("load", ("x.zarr",)), ("load_sweep", ("x",)),
                        ("sweep", ("x", {}))):
    try:
        getattr(gs, name)(*arguments)
    except gs.errors.MissingDependencyError as error:
        print(error)
print(command("export a.zarr a.csv")[2].strip())
""", cwd=tmp_path).splitlines()
    assert lines == [*lines[:1] * 4, f"gyrospark: {lines[0]}"]
    assert install("storage") in lines[0]
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]
    answer = gyrospark("run", "fast-top", "--scheme", "EMS", "--dt", "1e-3", "--steps", "20",
                       "--every", "3", "--out", "b.csv")
    assert answer.code == 0, answer.stderr
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_what_needs_an_extra_says_so_before_it_computes(tmp_path):
    """Calls without an extra work: stores are read by xarray, which without Dask has no chunks."""
    study_file(tmp_path)
    answers = json.loads(python(without(OPTIONAL) + FAST_TOP + COMMANDS + """
step = gs.stepper("EMS")
stored = step.integrate(top.q0, top.p0, dt=1e-3, steps=20, parameters=parameters, out="a.zarr")
assert (stored.dataset().q == stored[:].q).all()
stored[:].save("a.csv")
over = {"gamma": [8e-4, 1e-3], "dt": [1e-3, 2e-3]}
swept = gs.sweep(top, over, scheme="EMS", steps=5, out="s.zarr")
assert float(gs.load_sweep("s.zarr").energy_error_max.max()) == float(swept.energy_error_max.max())
print(json.dumps({text: command(text) for text in (
    RUN + "--out a.nc", RUN + "--plot a.png", "sweep study.toml --plot a.png",
    "sweep study.toml --dask tcp://127.0.0.1:1", "reproduce figure-5 --out report",
    "reproduce all --out report")}))
from gyrospark.commands.reproduce import _report_folder
assert _report_folder("all", None, as_json=False)[0] is None
assert 'pip install "matplotlib' in _report_folder("all", None, as_json=False)[1]
""", cwd=tmp_path))
    for text, (code, stdout, stderr) in answers.items():
        assert (code, stdout, stderr.count("\n")) == (2, "", 1), text
        assert "pip install" in stderr, text
    assert {path.name for path in tmp_path.iterdir() if path.name[0] != "."} == {
        "study.toml", "a.zarr", "a.csv", "s.zarr"}
