"""Mutants: places of the code where one change can be made, with the changed text.

Python is changed through its syntax tree, C through its tokens: operators, comparisons, signs,
and/or, not, numbers, returned values, dropped statements. Left out because no test can or should
see them: docstrings and comments, annotations, decorators, ``__all__``, blocks under TYPE_CHECKING,
strings, arguments of ``raise`` and of warnings, preprocessor lines and declarations of C.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["Mutant", "c_places", "mutants_of", "python_places"]

@dataclass(frozen=True)
class Mutant:
    """One change of one file."""

    file: str
    line: int
    function: str
    start: int  # of the replaced bytes
    end: int
    before: str
    after: str
    kind: str
    text: str  # of the line
    first: int = 0  # line of the statement

    @property
    def package(self) -> str:
        """Return the top folder."""
        return self.file.split("/")[0]

    @property
    def key(self) -> str:
        """Return the name of the mutant in the log, which outlasts a move of its file."""
        identity = "|".join([self.function, self.text, self.before, self.after, self.kind])
        return hashlib.sha256(identity.encode()).hexdigest()[:16]


Edit = tuple[int, int, str, str]  # start, end, replacement, kind
Place = tuple[int, str, list[Edit]]  # line, function, edits


# ---------------------------------------------------------------- places in Python

BINARY = {"Add": ("+", "-"), "Sub": ("-", "+"), "Mult": ("*", "/"), "Div": ("/", "*"),
          "Pow": ("**", "*"), "FloorDiv": ("//", "/"), "Mod": ("%", "*"), "MatMult": ("@", "*")}
COMPARISONS = {"Lt": ("<", "<="), "LtE": ("<=", "<"), "Gt": (">", ">="), "GtE": (">=", ">"),
               "Eq": ("==", "!="), "NotEq": ("!=", "=="), "Is": ("is", "is not"),
               "IsNot": ("is not", "is"), "In": ("in", "not in"), "NotIn": ("not in", "in")}
SILENT = {"remark", "warn", "warning", "debug", "info", "cast", "TypeVar", "NewType"}


def is_silent(node: ast.AST) -> bool:
    """Return whether a call does nothing but warn, or serves type checkers."""
    return isinstance(node, ast.Call) and (
        getattr(node.func, "attr", "") or getattr(node.func, "id", "")) in SILENT


class Places:
    """Yield (line, function, edits) for each statement of a Python file."""

    def __init__(self, source: bytes) -> None:
        self.source = source
        self.starts = [0]
        for line in source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))

    def at(self, node: Any) -> tuple[int, int]:
        """Return where a node begins and ends."""
        return (self.starts[node.lineno - 1] + node.col_offset,
                self.starts[node.end_lineno - 1] + node.end_col_offset)

    def statements(self, body: list[ast.stmt], name: str = "") -> Iterator[Place]:
        """Yield statements in the order of the file."""
        for node in body:
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                inner = f"{name}.{node.name}".strip(".")
                if not isinstance(node, ast.ClassDef):
                    defaults = [*self.inside(node.args.defaults),
                                *self.inside(node.args.kw_defaults)]
                    yield node.lineno, inner, defaults
                yield from self.statements(node.body, inner)
            elif not (isinstance(node, ast.If) and re.search("TYPE_CHECKING|__name__",
                                                             ast.dump(node.test))):
                yield node.lineno, name, [*self.dropped(node), *self.inside([node])]
                for field in ("body", "orelse", "finalbody"):
                    yield from self.statements(getattr(node, field, None) or [], name)
                for clause in (*getattr(node, "handlers", ()), *getattr(node, "cases", ())):
                    yield from self.statements(clause.body, name)

    def dropped(self, node: ast.stmt) -> Iterator[Edit]:
        """Yield the edits that replace or negate a statement."""
        start, end = self.at(node)
        if isinstance(node, ast.Return) and node.value is not None and not (
                isinstance(node.value, ast.Constant) and not node.value.value):
            yield (*self.at(node.value), "None", "returned value")
        elif isinstance(node, (ast.AugAssign, ast.Raise, ast.Continue, ast.Break)) or (
                isinstance(node, ast.Expr)
                and not isinstance(node.value, ast.Constant) and not is_silent(node.value)) or (
                isinstance(node, ast.Assign)
                and isinstance(node.targets[0], (ast.Attribute, ast.Subscript))):
            yield start, end, "pass", "dropped statement"
        elif isinstance(node, (ast.If, ast.While)):
            first, last = self.at(node.test)
            yield first, last, f"not ({self.source[first:last].decode()})", "negated condition"

    def inside(self, nodes: Iterable[Any]) -> Iterator[Edit]:
        """Yield the edits of expressions, without the edits of statements inside."""
        for node in nodes:
            if node is None or isinstance(node, (ast.JoinedStr, ast.Raise)):
                continue
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and (
                    node.targets[0].id == "__all__"):
                continue
            if is_silent(node) or (isinstance(node, ast.keyword) and node.arg == "strict"):
                continue  # lengths that differ would be an error of ours
            yield from self.of_expression(node)
            parts = [node.value] if isinstance(node, ast.AnnAssign) else (
                [node.test] if isinstance(node, ast.Assert) else ast.iter_child_nodes(node))
            yield from self.inside(
                child for child in parts
                if not isinstance(child, (ast.stmt, ast.excepthandler, ast.match_case)))

    def of_expression(self, node: ast.AST) -> Iterator[Edit]:
        """Yield the edits of one node."""
        if isinstance(node, ast.BinOp):
            yield from self.between(node.left, node.right, BINARY.get(type(node.op).__name__))
        elif isinstance(node, ast.AugAssign) and (pair := BINARY.get(type(node.op).__name__)):
            yield from self.between(node.target, node.value, (f"{pair[0]}=", f"{pair[1]}="))
        elif isinstance(node, ast.Compare):
            ends = [node.left, *node.comparators]
            for op, left, right in zip(node.ops, ends, ends[1:], strict=False):
                yield from self.between(left, right, COMPARISONS[type(op).__name__])
        elif isinstance(node, ast.BoolOp):
            pair = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
            for left, right in zip(node.values, node.values[1:], strict=False):
                yield from self.between(left, right, pair)
        elif isinstance(node, ast.UnaryOp) and not isinstance(node.op, ast.Invert):
            start = self.at(node)[0]
            sign = "not" if isinstance(node.op, ast.Not) else "-"
            yield start, start + len(sign), "", "sign or not"
        elif isinstance(node, ast.Constant) and isinstance(node.value, (bool, int, float)):
            start, end = self.at(node)
            if isinstance(node.value, bool):
                yield start, end, str(not node.value), "constant"
            elif isinstance(node.value, int):
                yield start, end, str(node.value + 1), "constant"
                yield start, end, str(node.value - 1), "constant"
            else:
                yield start, end, repr(2 * node.value if node.value else 1.0), "constant"

    def between(self, left: ast.AST, right: ast.AST,
                pair: tuple[str, str] | None) -> Iterator[Edit]:
        """Yield the exchange of an operator that lies between two nodes."""
        if pair is None:
            return
        first, last = self.at(left)[1], self.at(right)[0]
        gap = re.sub(rb"#[^\n]*", lambda m: b" " * len(m[0]), self.source[first:last])
        pattern = rb"\s+".join(re.escape(word.encode()) for word in pair[0].split())
        if operator := re.search(pattern, gap):
            yield first + operator.start(), first + operator.end(), pair[1], "operator"


def python_places(source: bytes) -> Iterator[Place]:
    """Yield the statements of a Python file with their edits."""
    yield from Places(source).statements(ast.parse(source).body)


# ---------------------------------------------------------------- places in C

C_TOKEN = re.compile(
    rb"(?P<skip>/\*.*?\*/|//[^\n]*|^[ \t]*\#(?:\\\n|[^\n])*|\"(?:\\.|[^\"])*\"|'(?:\\.|[^'])*'|\s+)"
    rb"|(?P<word>[A-Za-z_]\w*)|(?P<number>\.?\d(?:[eEpP][+-]|[\w.])*)"
    rb"|(?P<mark><<=|>>=|->|\+\+|--|[-+*/%<>=!&|^]=|&&|\|\||<<|>>|.)", re.DOTALL | re.MULTILINE)
C_SWAPS = {b"+": "-", b"-": "+", b"*": "/", b"/": "*", b"%": "*", b"<": "<=", b"<=": "<",
           b">": ">=", b">=": ">", b"==": "!=", b"!=": "==", b"&&": "||", b"||": "&&",
           b"+=": "-=", b"-=": "+=", b"*=": "/=", b"/=": "*=", b"++": "--", b"--": "++"}
C_TYPES = re.compile(
    rb"(.*_t|const|static|inline|void|int|long|double|float|char|unsigned|size_t|struct|typedef"
    rb"|union|enum|extern|restrict|lanes|mask|real|number|return|goto|else|do|case|default|for|if"
    rb"|while|switch|sizeof|[A-Z]\w*)$")


def c_places(source: bytes) -> Iterator[Place]:
    """Yield the lines of a C file with their edits."""
    tokens = [(m.lastgroup, m[0], m.start()) for m in C_TOKEN.finditer(source)
              if m.lastgroup != "skip"]
    edits: dict[int, list[Edit]] = defaultdict(list)
    functions: dict[int, str] = {}
    function, depth, round_ = "", 0, 0
    for i, (kind, text, start) in enumerate(tokens):
        before = tokens[i - 1] if i else ("mark", b";", 0)
        line, end = source.count(b"\n", 0, start) + 1, start + len(text)
        operand = before[1] in (b")", b"]") or (
            before[0] in ("word", "number") and not C_TYPES.match(before[1]))
        round_ += (text == b"(") - (text == b")")
        depth += (text == b"{") - (text == b"}")
        if kind == "word" and not depth and tokens[i + 1: i + 2] and tokens[i + 1][1] == b"(":
            function = text.decode()
        functions.setdefault(line, function)
        if not depth:
            continue
        if text in C_SWAPS and (operand or text in (b"++", b"--")):
            edits[line].append((start, end, C_SWAPS[text], "operator"))
        elif text in (b"-", b"!"):
            edits[line].append((start, end, "", "sign or not"))
        elif kind == "number" and not (before[1] == b"[" and declares(tokens, i)):
            if text.isdigit():
                edits[line] += [(start, end, str(int(text) + 1), "constant"),
                                (start, end, str(int(text) - 1), "constant")]
            elif re.fullmatch(rb"\d+\.\d*", text):
                edits[line].append((start, end, repr(2 * float(text) or 1.0), "constant"))
        if before[1] in (b";", b"{", b"}", b")", b"else") and not round_ and kind == "word" and (
                source[start - 6:start] != b"(void)" and not C_TYPES.match(text)) and (
                tokens[i + 1][0] != "word" and tokens[i + 1][1] != b":"):
            last = next(position for _, mark, position in tokens[i:] if mark == b";")
            if b"{" not in source[start:last]:
                edits[line].append((start, last, "(void)0", "dropped statement"))
    for line, line_edits in sorted(edits.items()):
        yield line, functions[line], line_edits


def declares(tokens: list[tuple[str | None, bytes, int]], i: int) -> bool:
    """Return whether the statement around a token declares: its length may be larger."""
    while i and tokens[i - 1][1] not in (b";", b"{", b"}", b"("):
        i -= 1
    return C_TYPES.match(tokens[i][1]) is not None


def mutants_of(root: Path, package: str) -> list[list[Mutant]]:
    """Return the mutants of each statement of a package, or of one file."""
    statements = []
    folder = root / package
    for path in sorted(folder.rglob("*")) if folder.is_dir() else [folder]:
        source = path.read_bytes() if path.suffix in (".py", ".h") else b""
        lines = source.decode().split("\n")
        places = python_places if path.suffix == ".py" else c_places
        for first, function, edits in places(source) if source else ():
            mutants = []
            for start, end, after, kind in edits:
                line = source.count(b"\n", 0, start) + 1
                mutants.append(Mutant(
                    str(path.relative_to(root)), line, function, start, end,
                    source[start:end].decode(), after, kind, lines[line - 1].strip(), first))
            if mutants:
                statements.append(mutants)
    return statements
