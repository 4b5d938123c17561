"""Mutants are one place each, parse, and lie where a test can see them."""

from __future__ import annotations

import ast
import random

import gyrospark
from mutants import c_places, mutants_of, python_places
from processes import ROOT

PYTHON = '''
"""A docstring with 1 + 1."""
from typing import TYPE_CHECKING
__all__ = ["f"]
if TYPE_CHECKING:
    N = 1


@decorated(2)
def f(x: "3", *, most: int = 4) -> Literal[5]:
    """Return 6 - 6."""
    if not (x <= most) and x:  # 7 < 8
        raise ValueError(f"{x + 9} is more than {most}")
    return -x
'''
C = b"""
#define LIMIT 1 + 1
static void f(double *x, int n)
{
    double y[2];  /* 3 - 3 */
    for (int i = 0; i < n; ++i)
        y[i] = -x[i]*y[1];
    g(y);
}
"""


def changes(places, source):
    found = {(source[start:end].decode(), after)
             for _, _, edits in places(source) for start, end, after, _ in edits}
    assert found
    return found


def test_python_is_changed_where_it_runs():
    assert changes(python_places, PYTHON.encode()) == {
        ("4", "5"), ("4", "3"), ("not", ""), ("<=", "<"), ("and", "or"), ("-", ""), ("-x", "None"),
        ("not (x <= most) and x", "not (not (x <= most) and x)"),
        ('raise ValueError(f"{x + 9} is more than {most}")', "pass")}


def test_c_is_changed_where_it_runs():
    assert changes(c_places, C) == {
        ("0", "1"), ("0", "-1"), ("<", "<="), ("++", "--"), ("*", "/"), ("1", "2"), ("1", "0"),
        ("-", ""),
        ("y[i] = -x[i]*y[1]", "(void)0"), ("g(y)", "(void)0")}


def test_each_of_this_project_changes_one_place_and_parses():
    assert ROOT.samefile(gyrospark.__path__[0])
    mutants = [mutant for place in mutants_of(ROOT, "storage") for mutant in place]
    assert len(mutants) > 500
    for mutant in random.Random(0).sample(mutants, 60):
        source = (ROOT / mutant.file).read_bytes()
        changed = source[:mutant.start] + mutant.after.encode() + source[mutant.end:]
        assert changed != source
        assert source[mutant.start:mutant.end].decode() == mutant.before
        if mutant.file.endswith(".py"):
            ast.parse(changed)
