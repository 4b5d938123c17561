"""Patterns that tests look for in messages of errors, warnings and commands."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

#: An expression that is a message: stderr of a command, or an exception as text.
MESSAGE = re.compile(r"stderr|\.value\b|\bmessage\b|str\(\w*error|__notes__")
#: Text of a statement in which there may be one.
LIKELY = re.compile(rf"{MESSAGE.pattern}|match=|refused")
#: No prose: text in quotes or braces, name = value, lists of allowed values, escapes.
NAMES = re.compile(
    r"""'[^']*'|"[^"]*"|`[^`]*`|\{[^{}]*\}|\\[wdsSWDbB]|[\w.]+ = (?:[^\s.]|\\\.)+"""
    r"""|(?:[\w.-]+, )+[\w.-]+(?: (?:or|and) [\w.-]+)?|[\w.-]+ (?:or|and) [\w.-]+""")


def plain_words(text: str) -> list[str]:
    """Return the words of prose in a pattern; of alternatives, the words of the longest."""
    prose = re.sub(r"\.\*|[\\()]", " ", NAMES.sub(" ", text))
    return max(([word for word in alternative.split()
                 if re.fullmatch(r"[A-Za-z]{2,}[.,;:?!]*", word)]
                for alternative in prose.split("|")), key=len)


def text_of(node: ast.AST) -> str | None:
    """Return the text of a literal, with {} for each inserted value."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(value) or "{}" for value in node.values)
    return None


class Sought(ast.NodeVisitor):
    """The literals of a file of tests that are looked for in messages: (line, text)."""

    def __init__(self, source: str) -> None:
        tree, lines = ast.parse(source), source.splitlines()
        self.tables = {node.targets[0].id: node.value for node in tree.body
                       if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)}
        self.scopes: list[ast.AST] = []
        self.found: set[tuple[int, str]] = set()
        for statement in tree.body:
            if LIKELY.search("\n".join(lines[statement.lineno - 1:statement.end_lineno])):
                self.visit(statement)

    def generic_visit(self, node: ast.AST) -> None:
        scope = isinstance(node, (ast.FunctionDef, ast.For, ast.ListComp, ast.GeneratorExp))
        self.scopes += [node] * scope
        super().generic_visit(node)
        del self.scopes[len(self.scopes) - scope:]

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg == "match":
            self.look(node.value)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        if isinstance(node.func, ast.Name) and node.func.id.startswith("refused"):
            for argument in node.args:
                self.look(argument)
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        if MESSAGE.search(ast.unparse(node.comparators[0])):
            self.look(node.left)
        elif MESSAGE.search(ast.unparse(node.left)):
            self.look(node.comparators[0])
        self.generic_visit(node)

    def look(self, node: ast.AST) -> None:
        """Take the literals of an expression, and of tables that a name in it runs through."""
        if (text := text_of(node)) is not None:
            self.found.add((node.lineno, text))  # type: ignore[attr-defined]
        elif isinstance(node, ast.Name):
            for expression in self.values(node.id):
                if not isinstance(expression, ast.Name):
                    self.look(expression)
        elif not isinstance(node, (ast.Call, ast.Lambda, ast.Compare, ast.Subscript)) or (
                isinstance(node, ast.Call) and ast.unparse(node.func) == "re.escape"):
            for child in ast.iter_child_nodes(node):
                self.look(child)

    def values(self, name: str) -> Iterator[ast.AST]:
        """Yield the values of a name: in loops, in parametrize, and in the module."""
        for scope in reversed(self.scopes):
            if isinstance(scope, ast.FunctionDef):
                for call in scope.decorator_list:
                    if isinstance(call, ast.Call) and ast.unparse(call.func).endswith(
                            "parametrize"):
                        names = re.findall(r"\w+", ast.unparse(call.args[0]))
                        if name in names:
                            yield from self.column(call.args[1], names.index(name), len(names))
                            return
                continue
            loops = [scope] if isinstance(scope, ast.For) else scope.generators  # type: ignore[attr-defined]
            for loop in loops:
                target = loop.target
                names = [ast.unparse(e) for e in getattr(target, "elts", [target])]
                if name in names:
                    yield from self.column(loop.iter, names.index(name), len(names))
                    return
        if name in self.tables:
            yield self.tables[name]

    def column(self, table: ast.AST, index: int, width: int) -> Iterator[ast.AST]:
        """Yield one entry of each row of a table."""
        if isinstance(table, ast.Call) and isinstance(table.func, ast.Attribute):
            table = table.func.value  # of a dictionary
        if isinstance(table, ast.Name):
            if table.id not in self.tables:
                yield from (e for e in self.values(table.id) if width == 1)
                return
            table = self.tables[table.id]
        rows = table.values if isinstance(table, ast.Dict) else getattr(table, "elts", [])
        for row in rows:
            if isinstance(row, ast.Call):
                row = ast.Tuple(elts=row.args)  # pytest.param
            if width == 1:
                yield row
            elif len(getattr(row, "elts", [])) == width:
                yield row.elts[index]
            elif isinstance(row, ast.Starred) and isinstance(row.value, ast.GeneratorExp):
                yield from self.column(ast.List(elts=[row.value.elt]), index, width)
