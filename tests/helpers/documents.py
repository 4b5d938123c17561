"""Commands and code in README and docs: file and line, and how tests shorten them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from processes import ROOT

#: Documents whose code a reader types, also on a machine without extras; pages of cells run in
#: the environment of the tests (test_site.py).
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def recipe(target: str) -> str:
    """Return the command of ``make`` for a target in its environment."""
    makefile = re.sub(r"\s*\\\n\s*", " ", (ROOT / "Makefile").read_text(encoding="utf-8"))
    rule = re.search(rf"^{target}:.*\n\t\$\(BIN\)/(.*)$", makefile, flags=re.MULTILINE)
    assert rule
    return rule[1]


#: Commands that take long, or that a machine may lack: pattern, replacement, reason.
SHORTER = [
    (r"^make demo$", recipe("demo"), "its environment is made; the bare one is another"),
    (r"--steps 1000000000 --every 1000\b", "--steps 20000 --every 1000", "a quarter of an hour"),
    (r"(sweep) examples/studies/gamma_dt.toml", r"\1 few.toml",
     "a million runs; the study of docs/sweeps.md is few.toml, with four of them"),
    (r"^(gyrospark examples copy) (pendulum.toml crane.urdf|all --to examples)",
     r"\1 all --to copies",
     "other pages have copied them here, and what is there is not overwritten"),
    (r"^(gyrospark verify --model (?:double_pendulum|examples/double_pendulum.toml) .*)",
     r"\1 --steps 20", "without optimisation orders are measured for six seconds"),
    (r"^(gyrospark run) double_top (--show)", r"\1 double_pendulum \2",
     "test_model_files.py derives and runs it, and here the pendulum is compiled"),
    (r"^(gyrospark lyapunov .*) --t-end 60\b", r"\1 --t-end 6", "ten times as long"),
    (r"^(cd \w+_c && cc .*) -O2\b", r"\1 -O0", "compilers take three seconds to optimise"),
    (r"^gyrospark verify$", "gyrospark verify --scheme G-L --stages 1",
     "all steppers of the paper, which a slow test of test_cli.py verifies"),
    (r"--t-end 20 (.*--show)", r"--t-end 0.2 \1", "a film of twenty pictures, not 120"),
    (r"^gyrospark reference (?!list).*", "gyrospark reference spherical-pendulum --quick",
     "docs/references.md would be written, and systems be compiled for half a minute"),
    (r"^gyrospark reproduce all --summary docs/paper.md", "gyrospark reproduce table-4",
     "half an hour"),
]

#: Commands that are not typed here: pattern, reason.
NOT_RUN = [
    (r"^pip (install|freeze)\b", "test_bare_machine.py installs what pip makes of the project, and "
                       "test_packaging.py compares the extras that are named"),
    (r"^(taskset -c 0 )?make (test|generated|docs|bench)",
     "the first runs these tests, the second writes to the repository, the third is typed by "
     "test_site.py, the fourth takes minutes"),
    (r"^pytest ", "it writes to the repository"),
    (r"^gyrospark (run|verify --model) (cassie.xml|robot.xml|ROBOT.xml|orbit.toml)",
     "files that are not those of the project"),
    (r"^gyrospark run examples/pumpjack.xml", "without optimisation seven seconds; test_mjcf.py "
                                              "puts the example together and runs another file"),
    (r"^gyrospark run delta_robot\b", "five seconds to derive and compile; "
                                      "test_run_names.py runs it"),
    (r"^gyrospark run examples/crane.urdf", "twelve seconds to derive; a slow test of test_site.py "
                                            "runs the crane, test_cli.py a file of a robot"),
    (r"^gyrospark (run|build)$", "the name of a command without what it takes"),
    (r"^gyrospark build (web|wasm|fmu)", "ziglang is half a minute of compiling; tests/targets "
                                         "builds them where it is installed"),
    (r"^gyrospark reproduce (?!table-4$|all)",
     "minutes each; all have tests of their own, and here their names are looked up"),
]

#: The form of a command, not a command: test_packaging.py compares its options.
FORM = re.compile(r"\b(FILE|PROBLEM|STUDY\.toml|NAME)\b|…| --out$")
COMMAND = re.compile(r"(generate|gyrospark|make|pip|pytest|taskset|cd) \S")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class Typed:
    """Something to type, where it stands, and the text of the section around it."""

    where: str
    text: str
    section: str

    @property
    def shortened(self) -> str:
        """The command as the tests type it."""
        text = self.text
        for pattern, replacement, _ in SHORTER:
            text = re.sub(pattern, replacement, text)
        return text

    @property
    def not_run(self) -> str:
        """The reason why the command is not typed; empty if it is."""
        return next((why for pattern, why in NOT_RUN if re.search(pattern, self.text)), "")


def quick(code: str) -> str:
    """Return code whose films have two pictures, which show as well that it works."""
    return re.sub(r"(?<=\.gif\", )seconds=\d+", "seconds=0.4", code)


def blocks(path: Path, language: str) -> list[Typed]:
    """Return the fenced blocks of a document in a language ("" for none)."""
    text = path.read_text(encoding="utf-8")
    return [_typed(path, text, block.start(2), block[2]) for block in FENCE.finditer(text)
            if block[1] == language]


def commands(path: Path) -> list[Typed]:
    """Return the commands of a document in their order: lines of blocks, and between backticks."""
    text = path.read_text(encoding="utf-8")
    texts = [(block.start(2) + offset, line) for block in FENCE.finditer(text) if not block[1]
             for offset, line in _lines(block[2])]
    prose = FENCE.sub(lambda block: re.sub(r"[^\n]", " ", block[0]), text)  # at the same places
    texts += [(span.start(1), span[1]) for span in re.finditer(r"`([^`\n]+)`", prose)]
    return [_typed(path, text, offset, line) for offset, line in sorted(texts)
            if COMMAND.match(line) and not FORM.search(line)]


def headings(text: str) -> set[str]:
    """Return the anchors that lead to the headings of a page."""
    return {re.sub(r"[^\w -]", "", heading.lower()).strip().replace(" ", "-")
            for heading in re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)}


def _lines(block: str) -> Iterator[tuple[int, str]]:
    """Yield the commands of a block; what stands below a ``$`` is what they print."""
    prompted = block.startswith("$ ")
    for line in re.finditer(r"^(?:.*\\\n)*.*$", block, flags=re.MULTILINE):
        plain = re.sub(r"\s*\\\n\s*", " ", re.sub(r"\s+# .*", "", line[0]))
        if plain.startswith("$ ") or not prompted:
            yield line.start(), plain.removeprefix("$ ")


def _typed(path: Path, text: str, offset: int, command: str) -> Typed:
    heading: Callable[[int], int] = lambda limit: text.rfind("\n## ", 0, limit)  # noqa: E731
    end = text.find("\n## ", offset)
    section = text[max(heading(offset), 0): end if end > 0 else len(text)]
    line = text.count("\n", 0, offset) + 1
    return Typed(f"{path.relative_to(ROOT)}:{line}", command, section)
