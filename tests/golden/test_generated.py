"""Generated text: the checked-in files, its reproducibility, how it grows, what it says.

The repository has those that wheels have compiled, and one of each other kind; a wheel has all of
the paper's. ``make generated`` brings the checked-in files up to date.
"""

from __future__ import annotations

import difflib
import re

import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.core.manifest import Manifest
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import PAPER_SPECS, Spec
from processes import ROOT, python

FOLDER = ROOT / "generated"

#: Each scheme and parametrisation; the others have the same text with other tables.
CHECKED_IN = (Spec("IMS"), Spec("EMS"), Spec("G-L", 2), Spec("G-L", 3), Spec("G-L", 4),
              Spec("LIIIA-B", 3, "alpha"))


@pytest.mark.parametrize("spec", CHECKED_IN, ids=lambda spec: spec.name)
def test_checked_in_files_are_up_to_date(spec, request):
    diff = []
    for name, text in generate(spec).source.files(standalone=False).items():
        path, new = FOLDER / name, text.encode()
        if request.config.getoption("--update"):
            path.write_bytes(new)
        old = path.read_bytes() if path.is_file() else b""
        if old != new:
            diff += difflib.unified_diff(
                old.decode(errors="replace").splitlines(), text.splitlines(), name,
                f"{name} (generated)", lineterm="", n=1)
            diff.append(f"({name}: {len(old)} bytes checked in, {len(new)} generated)")
    if diff:
        pytest.fail("\n".join([*diff[:80], "stale: `make generated`, or pytest --update"]),
                    pytrace=False)


def test_checked_in_are_of_the_paper_and_compiled_in_wheels():
    expected = {f"{spec.name}.{end}" for spec in CHECKED_IN for end in ("h", "c", "json")}
    assert {p.name for p in FOLDER.iterdir() if not p.name.startswith("_")} == expected
    assert {*CHECKED_IN} < {*PAPER_SPECS}
    assert len(PAPER_SPECS) == 20


def test_bytes_do_not_depend_on_the_hash_seed(tmp_path):
    """A process with another hash seed generates the bytes of the folder, as this one does.

    Nor do they depend on earlier generated files, which differ from case to case above.
    """
    code = (
        "from gyrospark.generator.pipeline import generate\n"
        "from gyrospark.generator.spec import Spec\n"
        "for name, text in generate(Spec('EMS')).source.files(standalone=False).items():\n"
        "    with open(name, 'w', encoding='utf-8') as file:\n"
        "        file.write(text)\n"
    )
    python(code, cwd=tmp_path, PYTHONHASHSEED="12345")
    assert len(list(tmp_path.iterdir())) == 3
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (FOLDER / path.name).read_bytes()


# ---------------------------------------------------------------- growth


def parts(scheme, stages):
    """Return the C without its name and tableau, and the tableau's initialiser."""
    spec = Spec(scheme, stages)
    text = generate(spec).source.source.replace(spec.name, "NAME")
    text = text.replace(spec.name.upper(), "NAME")
    text = re.sub(r"^(enum \{ N = ).*$", r"\1", text, count=1, flags=re.MULTILINE)
    text = text.replace(f"{stages}-{scheme} ", "S-SCHEME ")
    start = text.index("coefficients of the SPARK method")
    table = text.index("static const NAME_tableau tableau = {")
    end = text.index("};", table)
    fast = re.compile(r"^static const real (?:table|even_odd)_\w+\[.*?\n\};\n",
                      re.MULTILINE | re.DOTALL)
    code = fast.sub("", text[:start] + text[end:])
    return code.replace("#define PRODUCT NOINLINE", "#define PRODUCT INLINE"), text[table:end]


@pytest.mark.parametrize(("scheme", "stages"), [
    ("LIIIA-B", (2, 4)), *(pytest.param("G-L", stages, marks=pytest.mark.slow)
                          for stages in ((8, 9), (1, 2, 6)))])
def test_only_the_tables_grow_with_the_stages(scheme, stages):
    """
    C size grows like s²: all but the tableau is the same text for every s whose tables lanes
    multiply in one way, as they stand or by halves.
    """
    codes, tables = zip(*(parts(scheme, s) for s in stages), strict=True)
    assert len(set(codes)) == 1
    for s, table in zip(stages, tables, strict=True):
        p = {"G-L": s, "LIIIA-B": s - 1}[scheme]
        entries = 2 * s * s + 2 * s * (p + 1) + 3 * s + 2 * (p + 1)
        numbers = re.findall(r"[{ ](-?[0-9][0-9.e+-]*)", table)
        assert len(numbers) == entries
        assert len(table) <= 26 * entries + 40 * s + 400  # 17 digits, sign, point, exponent
        assert table.count("\n") <= 4 * s + 30 + len(table) // 60  # rows of 100 columns


# ---------------------------------------------------------------- what it says


def test_c_is_plain_ascii_text():
    for path in FOLDER.glob("*.[ch]"):
        content = path.read_bytes()
        assert content.isascii(), path
        assert not re.search(rb"[\t\r]| $|\n\n\n", content, flags=re.MULTILINE), path
        assert content.endswith(b"\n"), path


@pytest.mark.parametrize("spec", CHECKED_IN, ids=lambda spec: spec.name)
def test_comments_carry_equations_and_operation_counts(spec):
    header = (FOLDER / f"{spec.name}.h").read_text(encoding="ascii")
    source = (FOLDER / f"{spec.name}.c").read_text(encoding="ascii")
    manifest = Manifest.from_text((FOLDER / f"{spec.name}.json").read_text(encoding="utf-8"))
    assert "q' = H_p(q, p),   p' = -H_q(q, p) - g_q(q)^T lambda,   0 = g(q)" in header
    H = manifest.system.hamiltonian.replace("**", "^")
    assert f"* H = {H}\n" in header
    assert "* g = q0^2 + q1^2 + q2^2 + q3^2 - 1\n" in header
    assert f"{manifest.scheme.unknowns} unknowns a step" in header
    assert f"order {manifest.scheme.order}" in header
    assert "kg m^2" in header
    for kernel, counts in manifest.operations.items():
        text = ", ".join(f"{count} {kind}" for kind, count in counts.items()) or "no operations"
        assert re.search(rf"\* +{kernel} +{re.escape(text)}\n", source), kernel
    if spec.stages:
        assert "A_tilde" in source
        assert "(B.1)" in source


@pytest.mark.parametrize("spec", CHECKED_IN, ids=lambda spec: spec.name)
def test_c_needs_only_math_and_no_memory_of_its_own(spec):
    """It has no malloc, no variable statics, and no headers but <math.h> and freestanding ones."""
    source = (FOLDER / f"{spec.name}.c").read_text(encoding="ascii")
    header = (FOLDER / f"{spec.name}.h").read_text(encoding="ascii")
    includes = set(re.findall(r"#include [<\"](.*?)[>\"]", header + source))
    engine_headers = {name for name in includes if name.startswith("gyrospark/")}
    assert all((ROOT / "engine" / name).is_file() for name in engine_headers)
    assert includes - engine_headers == {f"{spec.name}.h", "float.h", "math.h", "stddef.h"}
    for word in ("malloc", "calloc", "free(", "printf", "exit(", "errno", "goto", "setjmp"):
        assert word not in source
    for line in re.findall(r"^\s*static .*[;={]?$", source, flags=re.MULTILINE):
        assert "(" in line or "static const" in line, line


def test_manifest_is_the_contract():
    for spec in CHECKED_IN:
        manifest = Manifest.from_text((FOLDER / f"{spec.name}.json").read_text(encoding="utf-8"))
        assert manifest.name == spec.name
        assert manifest.real == "double"
        assert list(manifest.system.parameters) == ["I1", "I2", "I3", "mgl", spec.rep]
        assert manifest.scheme.stages == spec.stages
        if spec.scheme in ("IMS", "EMS"):
            unknowns, multipliers, order = 9, 1, 2
        else:
            p = spec.stages if spec.scheme == "G-L" else spec.stages - 1
            unknowns, multipliers = 8 * spec.stages + p, p + 1
            order = 2 * spec.stages - (0 if spec.scheme == "G-L" else 2)
        assert manifest.scheme.unknowns == unknowns
        assert manifest.scheme.multipliers == multipliers
        assert manifest.scheme.order == order


def test_real_types_differ_in_literals_and_functions():
    texts = {real: generate(Spec("G-L", 2, real=real)).source.source
             for real in ("float", "long-double")}
    assert "#define MATH(function) function##f\n" in texts["float"]
    assert "#define MATH(function) function##l\n" in texts["long-double"]
    for real, suffix in (("float", "f"), ("long-double", "L")):
        table = texts[real][texts[real].index("_tableau tableau = {"):]
        table = table[: table.index("};")]
        assert all(number.endswith(suffix) for number in re.findall(r"[0-9][0-9.e+-]*\w?", table)
                   if "." in number)
        assert "double" not in texts["float"]


def test_text_of_a_system_cannot_leave_its_comment():
    """Names of a user's system become C: those that could end a comment or a line do not."""
    q, p = sp.symbols("x y", real=True), sp.symbols("px py", real=True)
    m = sp.Symbol("m", positive=True)
    H = (p[0] ** 2 + p[1] ** 2) / (2 * m) + q[0] ** 2 * q[1] / (m * q[1] + 3)
    for name in ("*/ int evil;/*", "a b", "1st", "", "a\nb", "ä"):
        with pytest.raises(gs.InputError):
            gs.System(q, p, (m,), H=H, constraints=[q[0] ** 2 + q[1] ** 2 - 1], name=name)
    for bad in ("*/", "double", "a b", "x;", "p->q", ""):
        symbol = sp.Symbol(bad, positive=True)
        with pytest.raises(gs.InputError):
            gs.System(q, p, (symbol,), H=H.subs(m, symbol),
                      constraints=[q[0] ** 2 + q[1] ** 2 - 1], name="fine")
