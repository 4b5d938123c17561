"""``make bench``: speed and precision of gyrospark and other programs, in tables.

For steady numbers pin the run to one core (taskset -c 0 make bench), all but ensemble and sweeps,
which have several workers. Exit code 1 if one of gyrospark's own runs fails.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import gyrospark as gs

from .machine import about
from .peers import PROGRAMS
from .rows import Choice, Row, accuracies, as_json, draw, markdown, table

__all__ = ["BENCHMARKS", "main"]


@dataclass(frozen=True)
class Benchmark:
    """A benchmark: the functions that return its rows, and the columns of its picture.

    Attributes
    ----------
    module, functions : str, tuple of str
        In this package; each returns rows.
    about : str
        One line.
    picture : pair of str
        Columns on the axes.
    """

    module: str
    functions: tuple[str, ...]
    about: str
    picture: tuple[str, str] = ("", "")


BENCHMARKS: dict[str, Benchmark] = {
    "peers": Benchmark("equal_error", ("peers",), "programs at equal error: the page docs/peers.md",
                       ("error", "CPU ms")),
    "top": Benchmark("fast_top", ("top",), "cost and error of the fast top",
                     ("dx (m)", "CPU µs/s")),
    "step": Benchmark("fast_top", ("step",), "each solver of a step, over dense Newton"),
    "ensemble": Benchmark("fast_top", ("ensemble",), "64 tops at once", ("dx (m)", "CPU µs/s")),
    "drift": Benchmark("fast_top", ("drift",), "energy and position up to 1000 s",
                       ("t (s)", "ΔH/H")),
    "bodies": Benchmark("bodies", ("bodies", "mechanics", "batches"),
                        "bodies on joints, models of sympy.physics.mechanics, batches",
                        ("error (m)", "CPU ms")),
    "store": Benchmark("stores", ("store",), "what streaming a run to a store adds"),
    "sweeps": Benchmark("sweeps", ("sweeps",), "sweeps beside an ensemble of the same cells"),
    "events": Benchmark("events", ("events",), "events and states between steps",
                        ("error of times", "with event (ms)")),
    "impacts": Benchmark("impacts", ("impacts",), "elastic impacts of a ball and of a stop",
                         ("error (m)", "CPU µs/hit")),
    "beams": Benchmark("beams", ("beams",), "a thin steel rod that falls", ("error (m)", "CPU ms")),
    "gradients": Benchmark("gradients", ("gradients", "derivatives"),
                           "gradients of a loss; adjoints and tangents over the run",
                           ("error", "gradient (ms)")),
    "adaptive": Benchmark("adaptive", ("adaptive",),
                          "eccentric orbits: steps in scaled time and constant ones",
                          ("error", "CPU µs/period")),
    "scale": Benchmark("scale", ("scale",), "costs against bodies, stages, trajectories, numbers",
                       ("size", "step (s)")),
    "references": Benchmark("references", ("references",), "problems with known digits",
                            ("CPU ms", "error")),
    "robots": Benchmark("robots", ("robots",), "mechanisms with closed loops over a million steps"),
}


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmarks that the command line names; return the exit code."""
    options = _parser().parse_args(words)
    programs = tuple(options.programs.split(",")) if options.programs else PROGRAMS
    unknown = [name for name in programs if name not in PROGRAMS]
    if unknown:
        raise gs.InputError(f"Unknown program {unknown[0]!r}; choose {', '.join(PROGRAMS)}.")
    rounds = options.rounds or (3 if options.quick else 5)
    choice = Choice(programs, options.quick, rounds, options.t_end, options.only, options.base,
                    tuple(options.mjcf), lambda text: print(text, file=sys.stderr))
    results = {name: measure(BENCHMARKS[name], choice)
               for name in (BENCHMARKS if options.what == "all" else [options.what])}
    document = {"about": about(programs)} | {name: as_json(rows) for name, rows in results.items()}
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        text = json.dumps(document, indent=2, ensure_ascii=False)
        (options.out / "bench.json").write_text(text + "\n", encoding="utf-8")
        for name, rows in results.items():
            write(name, rows, choice, options.out)
    if options.json:
        print(json.dumps(document, indent=2, ensure_ascii=False))
    else:
        for name, rows in results.items():
            show(name, rows, choice)
    return int(any(row.failed for rows in results.values() for row in rows))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="make bench", formatter_class=argparse.RawDescriptionHelpFormatter,
        description=__doc__, epilog="\n".join(
            f"{name:12}{benchmark.about}" for name, benchmark in BENCHMARKS.items()))
    parser.add_argument("what", nargs="?", default="peers", choices=[*BENCHMARKS, "all"],
                        metavar="WHAT", help="peers (default), one of those below, or all")
    parser.add_argument("--programs", metavar="A,B", help=f"of {', '.join(PROGRAMS)} (all)")
    parser.add_argument("--quick", action="store_true", help="few settings, short runs")
    parser.add_argument("--t-end", type=float, metavar="T", help="simulated seconds of the top")
    parser.add_argument("--rounds", type=_positive, metavar="N",
                        help="timed runs of each (5; with --quick 3)")
    parser.add_argument("--only", default="", metavar="TEXT", help="cases with TEXT in their name")
    parser.add_argument("--base", default="", metavar="TEXT",
                        help="costs over those of the first row with TEXT in its name")
    parser.add_argument("--mjcf", type=Path, action="append", default=[], metavar="FILE.xml",
                        help="of robots: a robot in MJCF, too")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write bench.json, pictures, pages")
    parser.add_argument("--json", action="store_true", help="print JSON")
    return parser


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{number} rounds measure nothing; give 1 or more")
    return number


def measure(benchmark: Benchmark, choice: Choice) -> list[Row]:
    """Return the rows of a benchmark."""
    module = import_module(f".{benchmark.module}", __package__)
    return [row for name in benchmark.functions for row in getattr(module, name)(choice)]


def tables(name: str, rows: list[Row], choice: Choice) -> dict[str, list[list[str]]]:
    """Return title → table: one for all cases, or one for each where columns differ."""
    about = BENCHMARKS[name].about
    if name == "scale":
        from .scale import laws

        rows = [*rows, *laws(rows)]
        return {case: table([row for row in rows if row.case == case])
                for case in dict.fromkeys(row.case for row in rows)}
    if name == "peers":
        from .equal_error import levels, losses

        return {**levels(rows), "where another program is cheaper": losses(rows)}
    cheapest_table = {}
    if name == "bodies":
        from .bodies import ACCURACIES, COST, ERROR

        cheapest_table = {
            "cheapest for an error": table(accuracies(rows, COST, ERROR, ACCURACIES, " m"))}
    if name == "adaptive":
        from .adaptive import levels as levels_of

        cheapest_table = {"cheapest for an error": table(levels_of(rows))}
    groups: dict[str, list[Row]] = {}
    for row in rows:  # rows without numbers join the rows before them
        cost = next(iter(row.numbers), next(reversed(groups), ""))
        groups.setdefault(cost, []).append(row)
    return {f"{about}{', continued' * bool(i)}": table(group, choice.base)
            for i, group in enumerate(groups.values())} | cheapest_table


def show(name: str, rows: list[Row], choice: Choice) -> None:
    """Print the tables of a benchmark."""
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else 320)
    for title, (head, *lines) in tables(name, rows, choice).items():
        grid = Table(title=title, title_justify="left")
        for number, column in enumerate(head):
            grid.add_column(column, justify="right" if number > 2 else "left",
                            no_wrap=number > 2)
        for line in lines:
            grid.add_row(*line)
        console.print(grid)


def write(name: str, rows: list[Row], choice: Choice, out: Path) -> None:
    """Write the picture of a benchmark, and the page of the documents that it makes."""
    if BENCHMARKS[name].picture[0]:
        draw(rows, *BENCHMARKS[name].picture, out / f"{name}.png")
    pages: Mapping[str, Callable[[], str]] = {"scale": lambda: _scale_page(rows, choice)}
    if name == "references":
        from .references import page_of

        pages = {"references": lambda: page_of(rows, "references.png")}
    if name == "peers":
        from . import equal_error

        pages = {"peers": lambda: equal_error.page(rows, choice, about(()))}
    if name == "robots":
        from .robots import draw_drift, mechanisms, page

        shown = mechanisms(choice)
        draw_drift(rows, shown, out / "reference_robots.png")
        pages = {"reference_robots": lambda: page(rows, shown, "reference_robots.png")}
    for page_name, text in pages.items() if name in _PAGES else ():
        (out / f"{page_name}.md").write_text(text(), encoding="utf-8")


#: Benchmarks that write a page.
_PAGES = ("peers", "scale", "references", "robots")
_SCALE_PAGE = """# How costs grow

`make bench WHAT="scale --out DIR"` measures the costs below and writes this page as `DIR/scale.md`
on {machine}. Times are CPU seconds of all threads and of the compiler,
medians of {rounds} rounds. The slope is that of log(cost) against log(size): 1 is linear growth; of
bodies from 8 on. Every size is derived and compiled in a new process without a cache.

- **bodies**: a chain of bodies, 3-G-L; *step* is one of 1000 steps of 2 ms, *call of a step* an
  `integrate` of one step.
- **stages**: G-L on the fast top in long double, Δt = 1 ms; steps in double.
- **trajectories**: `integrate_ensemble` of fast tops, 3-G-L, 10 steps.
- **numbers**: a run of the fast top that stores every state, so many numbers in all; *read* are
  1000 of its states, *read memory* is the largest memory of that call, *disk* the size of the
  store.
"""


def _scale_page(rows: list[Row], choice: Choice) -> str:
    machine: dict[str, Any] = about(())
    head = _SCALE_PAGE.format(rounds=min(choice.rounds, 3), machine=(
        f"{machine['processor']}, {machine['cores']} cores, {machine['compiler']}"))
    return "\n".join([head, *(f"## {title.capitalize()}\n\n{markdown(lines)}"
                              for title, lines in tables("scale", rows, choice).items())])


if __name__ == "__main__":
    try:
        sys.exit(main())
    except gs.GyrosparkError as error:
        sys.exit(f"bench: {error}")
