"""WebAssembly and pages: texts, bits, the numbers that C gives a page, pages in Node.

Without ziglang all but the module is tested: ``glue.c`` by the compiler that is here, and texts.
"""

from __future__ import annotations

import ctypes
import html
import json
import re
import shutil
import subprocess

import numpy as np
import pytest

import gyrospark as gs
from calls import RUN, TOP
from gyrospark.runtime.plotting.html_view import compact, drawing, page_file
from gyrospark.runtime.plotting.scene import scene_of
from gyrospark.targets import build as build_module
from gyrospark.targets.build import build
from gyrospark.targets.native import C_FLAGS, native_bits
from gyrospark.targets.tools import TOOLS
from gyrospark.targets.web import page as page_module
from gyrospark.targets.web import webassembly
from processes import ROOT

DATA = ROOT / "tests" / "data"
SATELLITE = {"system": ROOT / "examples" / "control_c" / "satellite.toml",
             "scheme": ["1-G-L", "IMS", "splitting"], "order": 2, "parameters": {"u1": 0.01}}
TOPS = {"system": "fast-top", "dt": 1e-3, "scheme": ["3-G-L", "EMS"]}

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="Node is not installed")
needs_zig = pytest.mark.skipif(TOOLS["zig"].find() is None, reason="ziglang is not installed")


@pytest.fixture
def text_alone(monkeypatch):
    """Write pages without a compiler: all but their module."""
    monkeypatch.setattr(build_module, "require", lambda *_: [])
    monkeypatch.setattr(page_module, "compile", lambda folder, platforms: folder / "page.html")


def content_of(page):
    return json.loads(page.split('id="content">')[1].split("</script>")[0])


def test_a_page_is_its_files_and_the_numbers_of_a_model(text_alone, tmp_path, request):
    page = build("web", **SATELLITE, out=tmp_path / "page.html").path.read_text(encoding="utf-8")
    scripts = (drawing(), *map(webassembly.read, ("stepper.js", "page.js")))
    for text in (page_file("view.css"), webassembly.read("page.css"), *map(compact, scripts)):
        assert text in page
    assert re.findall(r"@[A-Z_]+@", page) == ["@MODULE@"]
    assert not re.search(r"https?://|src=|import ", page)  # no network
    assert len(page) < 80_000  # a module of one scheme has some 5 kB
    content = content_of(page)
    del content["hash"], content["meshes"]  # of the C and of solids, which have tests of their own
    golden = DATA / "targets" / "web" / "satellite.json"
    if request.config.getoption("--update"):
        golden.parent.mkdir(exist_ok=True)
        golden.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n",
                          encoding="utf-8")
    assert content == json.loads(golden.read_text(encoding="utf-8"))


@pytest.mark.slow  # derives a double pendulum
def test_sliders_leave_out_what_the_start_depends_on(text_alone, tmp_path):
    artefact = build("web", "double-pendulum", scheme="IMS", dt=5e-3, out=tmp_path / "page.html")
    content = content_of(artefact.path.read_text(encoding="utf-8"))
    names = {x["name"] for x in content["numbers"]}
    assert content["jointed"]
    assert {"a_m", "b_I3", "gravity_z"} <= names
    assert not {"joint_a_z", "joint_b_z"} & names  # in constraints
    assert [content["velocities"][i]["name"] for i in content["spins"]] == [
        f"{body}_omega_{axis}" for body in "ab" for axis in "xyz"]


def test_a_playground_is_the_page_of_build(text_alone, tmp_path):
    view = gs.playground(SATELLITE["system"], scheme="IMS")
    page = build("web", SATELLITE["system"], scheme="IMS", out=tmp_path / "page.html").path
    assert view.page == page.read_text(encoding="utf-8")
    assert "satellite" in repr(view)


@pytest.mark.parametrize("name", ["out", "target", "colour"])
def test_a_playground_refuses_what_it_does_not_take(name):
    with pytest.raises(gs.InputError, match=f"'{name}'.*parameters"):
        gs.playground("fast-top", dt=1e-3, **{name: "web"})


def test_text_of_a_model_stays_text(text_alone, tmp_path):
    model = tmp_path / "model.toml"
    text = SATELLITE["system"].read_text(encoding="utf-8")
    model.write_text(text.replace("under the torques", "</script><b>&amp;"), encoding="utf-8")
    page = build("web", model, scheme="IMS", out=tmp_path / "p.html").path
    page = page.read_text(encoding="utf-8")
    assert "</script><b>" not in page
    assert "</script><b>&amp;" in content_of(page)["about"]


def test_what_a_page_cannot_show_is_refused(text_alone, tmp_path):
    with pytest.raises(gs.InputError, match="rigid body"):
        build("web", ROOT / "examples" / "pendulum.toml", scheme="IMS", out=tmp_path / "p.html")
    with pytest.raises(gs.InputError, match="G-M"):
        build("web", **SATELLITE | {"scheme": ["G-M", "IMS"]}, out=tmp_path / "p.html")
    with pytest.raises(gs.InputError, match="scheme"):
        build("web", **SATELLITE | {"scheme": [np.zeros((2, 2))]}, out=tmp_path / "p.html")
    with pytest.raises(gs.InputError, match="99"):
        build("web", **SATELLITE | {"scheme": ["99-G-L", "IMS"]}, out=tmp_path / "p.html")


@pytest.mark.parametrize(("options", "said"), [
    ({"scheme": "2-G-L,IMS", "stages": 4}, "stages = 4 .*2-G-L, IMS"),
    ({"scheme": ["2-G-L"], "stages": 3}, "stages = 3 .*2-G-L"),
    ({"scheme": "2-G-L,IMS", "order": 4}, "order = 4 .*2-G-L, IMS"),
    ({"scheme": "2-G-L,IMS", "composition": "Suzuki"}, "composition = 'Suzuki' .*2-G-L, IMS")])
def test_a_choice_that_no_scheme_takes_is_refused(text_alone, tmp_path, options, said):
    with pytest.raises(gs.InputError, match=said):
        build("web", "fast-top", dt=1e-3, **options, out=tmp_path / "p.html")


def test_equal_schemes_are_one(text_alone, tmp_path):
    artefact = build("web", "fast-top", dt=1e-3, scheme="G-L,2-G-L,IMS,2-G-L", stages=2,
                     out=tmp_path / "p.html")
    assert [stepper.name for stepper in artefact.options.steppers] == [
        "heavy_top_gl2_gamma", "heavy_top_ims_gamma"]


def test_a_page_holds_the_module_that_was_compiled(monkeypatch, tmp_path):
    module, page = bytes(range(256)), tmp_path / "page.html"
    page.write_text('<script id="content">{"wasm": "@MODULE@"}</script>', encoding="utf-8")

    def compiled(sources, target, *, level):
        assert (sources, level) == (tmp_path / "c", "-Oz")
        target.write_bytes(module)

    monkeypatch.setattr(page_module, "compile_module", compiled)
    page_module.compile(tmp_path, ())
    assert page_module.module_of(page.read_text(encoding="utf-8")) == module


def test_without_ziglang_the_cure_is_said(monkeypatch):
    monkeypatch.setattr(type(TOOLS["zig"]), "find", lambda self: None)
    with pytest.raises(gs.InputError, match="install ziglang"):
        gs.playground("fast-top", dt=1e-3)


@pytest.fixture(scope="module")
def glued(tmp_path_factory):
    """The satellite's steppers with glue.c, as one library each, by this machine's compiler."""
    folder = tmp_path_factory.mktemp("glue")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build_module, "require", lambda *_: [])
        patch.setattr(webassembly, "compile", lambda folder, platforms: folder)
        artefact = build("wasm", **SATELLITE, out=folder / "satellite")
    libraries = []
    for stepper in artefact.options.steppers:
        target = folder / f"{stepper.name}.so"
        subprocess.run([*TOOLS["cc"].find(), *C_FLAGS, "-O0", "-Wall", "-Wextra", "-Werror",
                        *webassembly.definitions(stepper.manifest), "-shared", "-fPIC", "glue.c",
                        "-o", target, "-lm"], cwd=artefact.path / "c", check=True)
        libraries.append(ctypes.CDLL(str(target)))
    return artefact, libraries


def test_many_steps_a_call_are_the_steps(glued):
    artefact, libraries = glued
    for stepper, library in zip(artefact.options.steppers, libraries, strict=True):
        q, p, work, counts = _run(stepper, library, artefact.options, 40)
        assert (bytes(q) + bytes(p)).hex() == native_bits(stepper, artefact.options, 40)
        assert counts[0] == 40
        assert (counts[1] >= 40) == (stepper.manifest.scheme.kind != "splitting")
        q[0], p[1] = q[0] + 1e-3, p[1] + 1e-2
        defects = (ctypes.c_double*2)()
        getattr(library, f"{stepper.name}_defects")(work, q, p, defects)
        assert defects[0] == pytest.approx(abs(np.dot(q, q) - 1), rel=1e-9)
        if stepper.manifest.scheme.kind != "mean":
            hidden = np.dot(q, p)  # of a stepper in γ, times the constant of its own
            assert defects[1] in (0, pytest.approx(abs(hidden), rel=1e-9))


def _run(stepper, library, options, steps):
    fields, name = options.parameters, stepper.name
    q, p = ((ctypes.c_double*len(x))(*x) for x in (options.q, options.p))
    values, counts = (ctypes.c_double*len(fields))(*fields.values()), (ctypes.c_double*2)()

    class Limits(ctypes.Structure):
        _fields_ = (("tolerance", ctypes.c_double), ("max_iterations", ctypes.c_int))

    size = getattr(library, f"{name}_work_size")
    size.restype = ctypes.c_size_t
    work = (ctypes.c_longdouble*(size()//16 + 1))()
    begin = getattr(library, f"{name}_begin")
    assert begin(work, values, ctypes.byref(Limits(0, 50)), ctypes.c_double(options.dt), q, p) == 0
    assert getattr(library, f"{name}_repeat")(work, q, p, steps, counts) == 0
    return q, p, work, counts


def test_functions_of_the_header_are_exported(glued):
    artefact, libraries = glued
    for stepper, library in zip(artefact.options.steppers, libraries, strict=True):
        names = webassembly.exported_functions(stepper.name, stepper.sources[f"{stepper.name}.h"])
        assert {f"{stepper.name}_{function}" for function in (
            "begin", "advance", "energy", "start", "velocity", "repeat")} <= {*names}
        assert all(hasattr(library, name) for name in names)


#: A module without steps: ``toy_begin`` returns the two parameters at the address that it is given.
TOY = """
const memory = new WebAssembly.Memory({ initial: 1 });
const exports = { memory, __heap_base: { value: 0 }, toy_work_size: () => 16,
  toy_begin: (_, at) => Number([...new Float64Array(memory.buffer, at, 2)].join("")) };
const start = { real: "double", parameters: { a: 1, b: 2 }, q: [0], p: [0], velocities: 0 };
for (const parameters of [{ a: 1, b: 2 }, { b: 3, a: 4 }, { b: 3 }, { a: 1, b: 2, c: 3 }]) {
  const toy = new Stepper({ exports }, "toy", start);
  toy.parameters = parameters;
  try { console.log(toy.begin(1)); } catch (error) { console.log(error.message); }
}
try { new Stepper({ exports }, "top", start); } catch (error) { console.log(error.message); }
"""


@needs_node
def test_parameters_in_javascript_go_by_their_names(tmp_path):
    """Their order is any; those that are missing or unknown are refused, as is a stepper."""
    (tmp_path / "toy.mjs").write_text(webassembly.read("stepper.js") + TOY, encoding="utf-8")
    in_order, in_another, missing, unknown, no_stepper = subprocess.run(
        ["node", tmp_path / "toy.mjs"], check=True, capture_output=True,
        text=True).stdout.splitlines()
    assert (in_order, in_another) == ("12", "43")
    assert missing == 'Parameter "a" is not given; give a, b.'
    assert unknown == 'Parameter "c" is unknown; give a, b.'
    assert '"top"' in no_stepper
    assert "schemes" in no_stepper


#: Text that glue.c includes in place of a stepper: fused multiply-adds with and without its own.
STUB = """
#define NAME(function) stub_##function
#define MATH(function) function
#define KERNEL(function) function
#include <string.h>
typedef double real;
typedef int state_t;
enum { N = 1 };
static int stub_advance(state_t *w, real *q, real *p) { return !w || !q || !p; }
static int stub_iterations(state_t *w) { return !w; }
int differs(double a, double b, double c)
{
    const double own = fma(a, b, c), that = (fma)(a, b, c);
    const float x = (float)a, y = (float)b, z = (float)c;
    const float mine = fmaf(x, y, z), other = (fmaf)(x, y, z);
    const int real_differs = !(isnan(own) && isnan(that)) && memcmp(&own, &that, sizeof own);
    return real_differs || (!(isnan(mine) && isnan(other)) && memcmp(&mine, &other, sizeof mine));
}
"""


def around(stub, folder, *flags):
    """Return a library of glue.c around a stub."""
    (folder / "stub.c").write_text(stub)
    target = folder / "stub.so"
    subprocess.run([*TOOLS["cc"].find(), *C_FLAGS, "-Wall", "-Wextra", "-Werror", *flags,
                    '-DSTEPPER="stub.c"', "-DSPARK=0", "-DSPLITTING=0", "-DCONSTRAINTS=0",
                    "-I", folder, "-shared", "-fPIC", ROOT / "targets" / "web" / "glue.c",
                    "-o", target, "-lm"], check=True)
    return ctypes.CDLL(str(target))


def test_more_steps_a_call_than_a_float_counts(tmp_path):
    """2^24 + 2 steps are counted, of a stub that refuses more and iterates every second step."""
    steps = 2**24 + 2
    stub = STUB.replace("typedef double", "typedef float").replace(
        "return !w || !q || !p;", f"return ++*w > {steps} || !q || !p ? 3 : 0;").replace(
        "return !w;", "return *w % 2;")
    work, counts = ctypes.c_int(0), (ctypes.c_float*2)()
    q, p = ctypes.c_float(0), ctypes.c_float(0)
    repeat = around(stub, tmp_path).stub_repeat
    assert repeat(*map(ctypes.byref, (work, q, p)), steps, counts) == 0
    assert work.value == steps
    assert [*counts] == [steps, steps / 2]


def test_fused_products_without_a_fused_product_have_its_bits(tmp_path):
    differs = around(STUB, tmp_path, "-D__wasm__").differs
    differs.argtypes = [ctypes.c_double]*3
    rng = np.random.default_rng(0)
    numbers = [0.0, -0.0, 5e-324, -1e-310, 1e-154, -1e200, 1.7e308, 3e38, 1e-45, np.inf, np.nan]
    numbers += list(np.ldexp(rng.uniform(-2, 2, 40), rng.integers(-1070, 1020, 40)))
    numbers += list(rng.uniform(-2, 2, 60))
    with np.errstate(all="ignore"):
        for a in numbers:
            for b in numbers:
                assert not differs(a, b, -(a*b)), (a, b)
                assert not differs(a, b, float(-(np.float32(a)*np.float32(b)))), (a, b)
        assert not any(differs(*rng.choice(numbers, 3)) for _ in range(2000))


@pytest.mark.slow  # Zig compiles its C library, once on a machine
@needs_zig
def test_bits_of_a_module_and_of_a_page_in_a_notebook(tmp_path):
    artefact = gs.build("wasm", **SATELLITE, out=tmp_path / "satellite")
    module = (artefact.path / f"{artefact.stepper.name}.wasm").read_bytes()
    assert b"wasi" not in module  # it imports nothing
    assert len(module) < 3*12_000
    if any(TOOLS[name].find() is not None for name in ("node", "wasmtime")):
        assert artefact.check().count("2000 steps") >= len(artefact.options.steppers)
    view = gs.playground(SATELLITE["system"], scheme="IMS")
    assert html.escape(view.page) in view._repr_html_()
    assert view.save(tmp_path / "page.html").read_text(encoding="utf-8") == view.page
    assert page_module.module_of(view.page)[:4] == b"\0asm"
    with pytest.raises(gs.InputError, match=r"page\.txt"):
        view.save(tmp_path / "page.txt")


@pytest.fixture(scope="module")
def heavy_top(tmp_path_factory):
    """The page of a top; Zig compiles it."""
    return build("web", **TOPS, out=tmp_path_factory.mktemp("page") / "heavy_top.html")


def in_node(page, *arguments):
    """Run a page in Node, with a document that counts; return its JSON output."""
    process = subprocess.run(["node", DATA / "run_page.js", page.path, *arguments], check=True,
                             capture_output=True, text=True)
    return json.loads(process.stdout)


@needs_zig
def test_a_page_is_small_and_asks_no_network(heavy_top):
    page = heavy_top.path.read_text(encoding="utf-8")
    assert len(page.encode()) <= 90_000
    assert not re.search(r"https?://|src=|import |@[A-Z_]+@", page)


@needs_zig
@needs_node
def test_a_page_has_the_bits_of_the_run_in_c(heavy_top):
    output = in_node(heavy_top, "#scheme=EMS&t=0.5")
    _, ems = heavy_top.options.steppers
    assert output["bits"] == native_bits(ems, heavy_top.options, 500)
    assert output["clock"].startswith("0.500")


@needs_zig
@needs_node
def test_settings_of_a_page_are_those_of_its_address(heavy_top):
    output = in_node(heavy_top, "#I1=0.003&body.nutation=60&body_omega_z=90&t=0&foo=1")
    assert "foo" in output["notice"]
    assert output["hash"] == "#body.nutation=60&body_omega_z=90&I1=0.003"
    top = gs.problems.fast_top()
    q = [np.cos(np.pi/6), np.sin(np.pi/6), 0, 0]
    np.testing.assert_allclose(output["q"], q, rtol=0, atol=1e-15)
    p = gs.Start.of_body(q, (0, 0, 90), (0.003, *top.inertia[1:])).p
    np.testing.assert_allclose(output["p"], p, rtol=1e-14, atol=1e-16)


@needs_zig
@needs_node
@pytest.mark.parametrize(("rate", "speed"), [(1e-17, 0.2), (120, 0.1)])
def test_the_speed_is_that_of_what_turns(heavy_top, rate, speed):
    """Round-off turns nothing, and a part of the 4 s of the motion takes a second on the page."""
    output = in_node(heavy_top, f"#body_omega_z={rate}&mgl=0&t=0")
    assert float(output["speed"]) == speed


@needs_zig
@needs_node
def test_a_step_that_fails_is_said_in_a_sentence(heavy_top):
    output = in_node(heavy_top, "#dt=0.04&t=1")
    assert output["steps"] < 25
    assert "step" in output["notice"]
    assert "fails" in output["notice"]


@needs_zig
@needs_node
def test_a_top_is_drawn_as_that_of_a_run(gl3, heavy_top):
    output = in_node(heavy_top)
    assert output["bad"] == 0
    assert sum(output["drawn"].values()) > 0
    assert output["steps"] > 10
    assert output["notice"] == ""
    assert output["paused"] == 0
    assert output["resumed"] > 0
    (drawn_body,) = output["shapes"]
    run = gl3.integrate(TOP.q0, TOP.p0, steps=40, **RUN)
    (body,) = scene_of(run, 2).parts
    np.testing.assert_allclose(drawn_body["tip"], body.tip, atol=1e-9)
    for shape, drawn in zip(body.shapes, drawn_body["shapes"], strict=True):
        assert (shape.kind, shape.colour) == (drawn["kind"], drawn["colour"])
        np.testing.assert_allclose(drawn["size"], shape.size, rtol=1e-9)
        np.testing.assert_allclose(drawn["centre"], shape.centre, atol=1e-9)
