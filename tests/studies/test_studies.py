"""The paper's numbers against ours: verdicts, tables, laws, the page and docs/paper.md."""

from __future__ import annotations

import csv
import io
import json
import math
import re
import xml.etree.ElementTree as ET
from collections import Counter

import numpy as np
import pytest
from click.testing import CliRunner

from gyrospark.commands.reproduce import _progress, reproduce
from gyrospark.core.errors import InputError
from gyrospark.studies import (
    accuracy,
    convergence,
    invariants,
    parameter,
    study_registry,
)
from gyrospark.studies.case_runner import Case, Engine, parameter_value, scheme_of
from gyrospark.studies.drawing import draw
from gyrospark.studies.iterations import _near_claim
from gyrospark.studies.line_fit import crossing, fit_line, fit_slope
from gyrospark.studies.printed import MISPRINTS, TABLE_4, TABLE_6, TABLE_7, Misprint
from gyrospark.studies.report import as_json, page, report_files, section
from gyrospark.studies.study_result import Cell, Claim, Panel, Series, Table
from gyrospark.studies.summary import (
    failing,
    iterations_note,
    requirements,
    unexpected,
    unexplained,
)
from gyrospark.studies.verdict import compare_value, same_digits, units_between
from processes import ROOT

#: Results that take well under a second each once their steppers are compiled.
QUICK = ("table-2", "table-4", "table-7", "figure-5")


@pytest.fixture(scope="module")
def engine() -> Engine:
    return Engine(short=True)


@pytest.fixture(scope="module")
def accuracy_tables(engine):
    return [accuracy.table_4(engine), accuracy.table_6(engine), accuracy.table_7(engine)]


@pytest.fixture(scope="module")
def quick_results(engine):
    return study_registry.compute(QUICK, engine)


RIGHT = Misprint(19, "2.387E-04", "a column is printed again")


@pytest.mark.parametrize(
    ("ours", "printed", "floor", "misprint", "verdict"),
    [
        (2.3549e-6, "2.35E-06", 0.0, None, "agrees"),
        (2.3551e-6, "2.35E-06", 0.0, None, "differs"),
        (2.3449e-6, "2.35E-06", 0.0, None, "differs"),
        (1e-14, "2.00E-14", 2e-14, None, "round-off"),
        (1e-14, "2.00E-14", 1.9e-14, None, "differs"),  # the paper's is above the floor
        (3e-14, "2.00E-14", 2e-14, None, "differs"),  # ours is above the floor
        (2.3871e-4, "2.20E-04", 0.0, RIGHT, "misprint"),
        (2.3881e-4, "2.20E-04", 0.0, RIGHT, "differs"),  # the erratum does not help
        (2.2e-4, "2.20E-04", 0.0, RIGHT, "agrees"),  # nor does it condemn what agrees
        (math.nan, "2.20E-04", 0.0, None, "differs"),
        (math.inf, "2.20E-04", 1.0, RIGHT, "differs"),
        (6.94, "6.9", 0.0, None, "agrees"),
        (9.4, "9", 0.0, None, "agrees"),
        (9.6, "9", 0.0, None, "differs"),
        (15.649, "15.65", 0.0, None, "agrees"),
    ],
)
def test_each_verdict_is_reachable_and_refutable(ours, printed, floor, misprint, verdict):
    cell = compare_value("row", "column", ours, printed, floor, misprint)
    assert cell.verdict == verdict
    assert cell.note or verdict in ("agrees", "differs")
    assert cell.paper == float(printed)


def test_a_lost_number_has_no_verdict():
    assert compare_value("row", "column", 1.0, None).as_dict() == {
        "row": "row", "column": "column", "paper": None, "ours": 1.0, "ratio": None,
        "verdict": "not printed", "note": "",
    }


def test_a_difference_says_by_how_much_and_why():
    assert compare_value("r", "c", 1.68e-6, "1.69E-06").note.startswith("1 unit ")
    assert compare_value("r", "c", 1.67e-6, "1.69E-06").note == ""  # needs a reason
    note = compare_value("r", "c", 1.67e-6, "1.69E-06", reason="known").note
    assert note.startswith("2 units ")
    assert note.endswith("; known")
    assert compare_value("r", "c", 5e-6, "1.69E-06").note == ""
    assert unexplained(Table(1, "", "", [compare_value("r", "c", 1.67e-6, "1.69E-06")]))
    assert not unexplained(Table(1, "", "", [compare_value("r", "c", 1.68e-6, "1.69E-06")]))


def test_digits_are_compared_at_the_printed_place():
    assert same_digits(0.00999999, "1.00E-02")
    assert units_between(0.0995, "1.00E-01") in (0, 1)
    assert units_between(-1.23, "1.25") == 248
    assert not same_digits(math.nan, "1.0")


def test_misprints_belong_to_printed_cells():
    tables = {4: TABLE_4, 6: TABLE_6, 7: TABLE_7}
    for (table, quantity, rule, column), misprint in MISPRINTS.items():
        printed = tables[table][quantity, "gamma", rule]
        wrong = printed[("IMS", "EMS", "3-LIIIA-B", "2-G-L").index(column)]
        assert not same_digits(float(misprint.right), wrong)


def test_parameter_rules():
    inertia = (2.0, 2.0, 0.5)
    assert parameter_value("m", inertia) == 1.5
    assert parameter_value("100m", inertia) == 150.0
    assert parameter_value("0.01m", inertia) == pytest.approx(0.015)
    assert parameter_value("ht", inertia) == 2.0
    assert parameter_value(0.3, inertia) == 0.3
    with pytest.raises(InputError, match="100m"):
        parameter_value("x", inertia)


def test_scheme_names():
    assert scheme_of("3-LIIIA-B") == ("LIIIA-B", 3)
    assert scheme_of("1-G-L") == ("G-L", 1)
    assert scheme_of("IMS") == ("IMS", None)
    assert Case("fast-top", "G-L", 2, "alpha", "m", 0.1, 1).method == "2-G-L"


def test_a_case_runs_once():
    messages: list[str] = []
    engine = Engine(watch=messages.append)
    case = Case("fast-top", "IMS", None, "gamma", "m", 0.001, 10)
    assert engine.trajectory(case) is engine.trajectory(case)
    assert engine.mean(case, "H") == pytest.approx(
        engine.trajectory(case).report.energy_error_mean, rel=1e-12)
    assert messages == ["fast-top, IMS-γ"]


def test_lines_and_crossings():
    line = fit_line([1.0, 2.0, 4.0], [3.0, 5.0, 9.0])
    assert (line.slope, line.offset, line.r_squared) == pytest.approx((2, 1, 1))
    assert fit_line([0.0, 1.0, 2.0], [0.0, 1.0, 0.0]).r_squared == pytest.approx(0)
    assert crossing([0.0, 1.0, 2.0, 3.0], [-1.0, 1e-20, 1.0, 3.0], 1e-16) == [1.0]
    assert crossing([0.0, 1.0], [1.0, 3.0]) == []


def test_slopes_drop_the_plateau():
    dt = [0.1, 0.2, 0.4, 0.8]
    errors = [1e-9, *(h**4 for h in dt[1:])]
    assert fit_slope(dt, errors, [1e-9] * 4) == (pytest.approx(4), 3)
    slope, used = fit_slope(dt, errors, [1.0] * 4)
    assert math.isnan(slope)
    assert used == 0


def test_accuracy_tables_agree(accuracy_tables):
    verdicts = Counter(cell.verdict for table in accuracy_tables for cell in table.cells)
    assert sum(verdicts.values()) == 120
    assert verdicts["agrees"] >= 96
    assert verdicts["agrees"] + verdicts["round-off"] >= 114
    assert verdicts["misprint"] == len(MISPRINTS)
    assert not any(unexplained(table) for table in accuracy_tables)
    assert all(claim.holds for claim in requirements(accuracy_tables))


def test_the_demands_can_fail(accuracy_tables):
    four, six, seven = accuracy_tables
    wrong = Table(4, four.title, four.about,
                  [Cell(cell.row, cell.column, cell.paper, 1.0, "differs") for cell in four.cells])
    assert not any(claim.holds for claim in requirements([wrong, six, seven]))


def test_round_off_is_where_a_scheme_keeps_the_quantity(accuracy_tables):
    """No number that is a truncation error hides behind the floor."""
    for table in accuracy_tables:
        for cell in table.cells:
            if cell.verdict == "round-off":
                assert cell.column == "EMS" or "γ̃_h" in cell.row or table.number == 7
                assert abs(cell.ours) < 1e-10


@pytest.mark.parametrize("study", [
    accuracy.figure_8, invariants.table_3, invariants.figure_6, invariants.figure_7,
    parameter.figure_11, parameter.figure_12,
    pytest.param(parameter.figure_13, marks=pytest.mark.slow),  # a stepper of four stages for this
], ids=lambda study: study.__name__)
def test_claims_hold(study, engine):
    result = study(engine)
    assert result.claims
    assert all(panel.series for panel in getattr(result, "panels", ()))
    assert [claim for claim in result.claims if not claim.holds] == []


def test_the_energy_of_the_motion_is_conserved_where_h_and_the_momentum_constraint_are(engine):
    """The 1.9e-9 J of EMS with γ_m are (qᵀp)²/(8γ), though the floor of H is 2e-9 J."""
    conserved = {(cell.row, cell.column) for cell in invariants.table_3(engine).cells if cell.note}
    assert {(row, column) for row, column in conserved if "Pp" in row} == {
        (f"E[|ΔH(q, Pp)|], α = {value}", "EMS") for value in ("γ_m", "γ_h")}


@pytest.mark.parametrize("sweep", parameter.FIGURE_15[:2], ids=lambda sweep: sweep.method)
def test_lobatto_laws(sweep, engine):
    x, y = parameter.measure(engine, sweep)
    inverse, direct = fit_line(x, y), fit_line([1 / a for a in x], y)
    law, rejected = (inverse, direct) if parameter.follows_inverse(sweep) else (direct, inverse)
    assert law.r_squared >= 0.999 > rejected.r_squared


@pytest.mark.parametrize("stages", [2, 3])
def test_lobatto_orders(stages, engine):
    slope, used = fit_slope(*convergence.measure(engine, convergence.FIGURE_16[stages][0]))
    assert used >= 3
    assert slope == pytest.approx(2 * stages - 2, abs=0.1)


@pytest.fixture(scope="module")
def files(quick_results):
    return report_files(quick_results)


def test_page_has_every_number_and_picture(files, accuracy_tables):
    text = files["paper.md"]
    for name in QUICK:
        assert f"\n`gyrospark reproduce {name}`\n" in text
    assert {*re.findall(r"!\[.*?\]\((.*?)\)", text)} == {n for n in files if n.endswith(".svg")}
    rows = {tuple(line.split(" | ")) for line in text.splitlines() if line.startswith("| ")}
    table = accuracy_tables[0]
    for row in {cell.row for cell in table.cells}:
        cells = [cell for cell in table.cells if cell.row == row]
        line_of_row, = (line for line in rows if line[0] == "| " + row.replace("|", "\\|")
                        and len(line) == 1 + len(cells)
                        and float(line[1].split()[0]) == pytest.approx(cells[0].ours, rel=1e-3))
        for text, cell in zip(line_of_row[1:], cells, strict=True):
            ours, paper = re.findall(r"[\d.]+(?:e[+-]\d+)?", text)
            assert float(ours) == pytest.approx(cell.ours, rel=1e-3)
            assert float(paper) == pytest.approx(cell.paper, rel=1e-2)
    assert len(list(page([table]).splitlines())) < len(page([table], complete=True).splitlines())


def test_files_next_to_the_page(files, quick_results):
    for result in quick_results:
        end = "csv" if isinstance(result, Table) else "svg"
        assert f"{result.name}.{end}" in files
    rows = list(csv.DictReader(io.StringIO(files["table-4.csv"])))
    assert len(rows) == 36
    assert list(rows[0]) == ["row", "column", "paper", "ours", "ratio", "verdict", "note"]
    assert not re.search(r"e-1[4-9]\b", page(quick_results))  # no digits of round-off


@pytest.mark.slow  # of the paper's pictures
def test_drawings_follow_the_page():
    """A drawing has curves of every panel, in the colours of the page around them."""
    panel = Panel("t", "x", "y", [Series(f"s{i}", [1.0, 2.0], [1.0, 2.0 + i], "o-")
                                  for i in range(3)], "log", "log", zero=False)
    svg = draw([panel] * 3, 2)
    assert "currentColor" in svg
    assert "#010203" not in svg
    assert "prefers-color-scheme:dark" in svg
    root = ET.fromstring(svg)
    axes = [e for e in root.iter() if e.get("id", "").startswith("axes_")]
    assert len(axes) == 3
    _, _, width, height = map(float, root.get("viewBox").split())
    assert width > 1.2 * height / 2 * 1.5  # two columns, two rows
    single = ET.fromstring(draw([panel], 2))
    assert float(single.get("viewBox").split()[2]) == pytest.approx(width / 2)


def test_json_holds_the_contract_and_no_nan(quick_results):
    document = json.loads(as_json(quick_results))
    assert set(document["results"]) == set(QUICK)
    cell = document["results"]["table-4"]["cells"][0]
    assert set(cell) == {"row", "column", "paper", "ours", "ratio", "verdict", "note"}
    assert cell["ratio"] == pytest.approx(cell["ours"] / cell["paper"])
    table = Table(4, "t", "a", [Cell("r", "c", 1.0, math.nan, "differs", "n")],
                  [Claim("s", "f", "w", np.float64(2.0) < 1)])
    result = json.loads(as_json([table]))["results"]["table-4"]
    assert result["cells"][0]["ours"] is None
    assert result["claims"][0]["holds"] is False
    assert [claim for _, claim in failing([table])] == table.claims


@pytest.fixture
def computed(engine, monkeypatch):
    """Let a command use the trajectories that are there already."""
    monkeypatch.setattr("gyrospark.studies.case_runner.Engine", lambda **options: engine)


@pytest.mark.parametrize(("result", "file"), [
    ("table-2", "paper.md"), ("table-2", "results.json"), ("table-2", "table-2.csv"),
    ("figure-5", "figure-5.svg")])
def test_a_summary_does_not_replace_a_file_of_the_report(result, file, tmp_path, monkeypatch):
    monkeypatch.setattr(study_registry, "compute", None)  # nothing is computed
    with pytest.raises(InputError, match=r"--summary.*--out"):
        CliRunner().invoke(reproduce, [
            result, "--out", str(tmp_path), "--summary", f"{tmp_path}/./{file}"],
            standalone_mode=False, catch_exceptions=False)
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("computed")
def test_command_prints_a_table_or_json():
    result = CliRunner().invoke(reproduce, ["table-4"], standalone_mode=False)
    assert result.return_value == 0
    assert "30 agrees" in result.output
    assert "2.35e-06" in result.output  # the paper's
    assert re.search(r"misprint: .*γ_h, EMS: .*19", result.output)
    result = CliRunner().invoke(reproduce, ["table-7", "--json"], standalone_mode=False)
    document = json.loads(result.output)
    assert (document["table"], len(document["cells"])) == (7, 36)


def test_a_terminal_shows_what_is_computed(monkeypatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    with _progress(3, quiet=False) as (advance, watch):
        advance("table-4", 1)
        watch("γ = h")
    assert all(text in terminal.getvalue() for text in ("table-4", "1 of 3", "γ = h"))


@pytest.mark.usefixtures("computed")
def test_command_writes_page_and_summary(tmp_path):
    result = CliRunner().invoke(
        reproduce, ["figure-11", "--out", str(tmp_path / "r"), "--summary",
                    str(tmp_path / "paper.md")], standalone_mode=False)
    assert result.return_value == 0
    assert {path.name for path in (tmp_path / "r").iterdir()} == {
        "paper.md", "results.json", "figure-11.svg"}
    assert "## Fig. 11." in (tmp_path / "paper.md").read_text(encoding="utf-8")


def test_command_names_what_it_knows():
    with pytest.raises(InputError, match=r"table-2.*table-14.*figure-5.*figure-16") as caught:
        CliRunner().invoke(reproduce, ["table-15"], standalone_mode=False, catch_exceptions=False)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("number", "noted"), [(7, False), (8, True)])
def test_tables_of_an_iteration_have_a_note(number, noted):
    results = [Table(number, "t", "a", [])]
    assert ("iteration" in iterations_note(results)) is noted
    assert iterations_note(results) in page(results)


CLAIMS = {
    "holds": Claim("s", "f", "w", holds=True),
    "known": Claim("s", "f", "w", holds=False, known="nobody knows how it was done"),
    "unknown": Claim("s", "f", "w", holds=False),
}


@pytest.mark.parametrize(("claim", "code", "words"), [
    ("holds", 0, "4 of 4 "),
    ("known", 0, "0 of 4 "),
    ("unknown", 1, "FAILS: s: f (wanted: w)\n"),
])
def test_exit_code_tells_what_is_known_from_what_is_not(claim, code, words, monkeypatch, tmp_path):
    """The report has what is known, too; progress is on stderr if piped, and none with --json."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(study_registry, "RESULTS", {
        f"table-{n}": lambda engine, n=n: Table(n, "t", "a", [], [CLAIMS[claim]] * 2)
        for n in (2, 3)})
    result = CliRunner().invoke(reproduce, ["all"], standalone_mode=False)
    assert result.return_value == code
    assert words in result.stdout
    assert result.stderr == "table-2: 1 of 2\ntable-3: 2 of 2\n"
    assert ("nobody knows" in result.stdout) is (claim == "known")
    text = (tmp_path / "report" / "paper.md").read_text(encoding="utf-8")
    assert ("nobody knows" in text) is (claim == "known")
    quiet = CliRunner().invoke(reproduce, ["all", "--json"], standalone_mode=False)
    assert quiet.stderr == ""
    assert json.loads(quiet.stdout)["results"]["table-2"]["claims"][0]["holds"] is (
        claim == "holds")


@pytest.mark.parametrize(("what", "met"), [("holds", 17), ("known", 14), ("unknown", 12)])
def test_what_is_known_of_table_10_is_bounded(what, met):
    """A result with fewer agreeing cells than ever is news."""
    cells = [Cell("r", f"c{i}", 1.0, 1.0, "agrees" if i < met else "differs", "n")
             for i in range(19)]
    claim = _near_claim("cells", cells, 17, certain=13)
    assert (claim.holds, bool(claim.known)) == (what == "holds", what == "known")


@pytest.mark.parametrize("folder", ["/dev/null/report", "file/report", "file", "page.html"])
def test_report_that_cannot_be_written_is_refused_at_once(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("mine")
    monkeypatch.setattr(study_registry, "compute", None)  # nothing is computed
    with pytest.raises(InputError, match=f"--out '{folder}'"):
        CliRunner().invoke(reproduce, ["table-2", "--out", folder], standalone_mode=False,
                           catch_exceptions=False)


def test_catalogue_is_complete():
    expected = {f"table-{n}" for n in range(2, 15)} | {f"figure-{n}" for n in range(5, 17)}
    assert {name for name in study_registry.RESULTS if not name.startswith("finding-")} == expected
    assert study_registry.chosen("all") == list(study_registry.RESULTS)


@pytest.mark.parametrize("name", [
    "table-2", "table-4", "table-6", "table-7", "figure-5", "figure-9",
    *(pytest.param(name, marks=pytest.mark.slow) for name in ("table-5", "figure-10"))])
def test_committed_summary_is_what_is_computed(name, engine):
    """These results are the same in the short version; -m slow checks the entire file."""
    committed = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    result = study_registry.RESULTS[name](engine)
    assert section(result) in committed
    assert [claim for claim in result.claims if not claim.holds] == []


@pytest.mark.slow
def test_whole_committed_summary_is_what_is_computed():
    """The texts agree but for last digits of numbers, and for tables that last bits decide."""
    results = study_registry.compute(study_registry.chosen("all"), Engine())
    computed, committed = (
        [re.sub(r"\d[\d.,]*(e[-+]\d+)?", "#", text) for text in page_text.split("\n## ")]
        for page_text in (page(results), (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")))
    sections = list(zip(computed, committed, strict=True))
    exact = [pair for pair in sections if not any("last bits decide" in text for text in pair)]
    assert 0 < len(sections) - len(exact) <= 7  # the verdicts, Tables 9 to 14
    assert [ours for ours, _ in exact] == [theirs for _, theirs in exact]
    assert unexpected(results) == []
