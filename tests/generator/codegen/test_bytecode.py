"""Templates are compiled to bytecode once."""

import sys
from pathlib import Path

import jinja2
import pytest

from gyrospark.generator.codegen.bytecode import Bytecode


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder with a template; bytecode goes to one beside it."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.setattr(sys, "pycache_prefix", str(tmp_path / "bytecode"))
    (tmp_path / "templates").mkdir()
    (tmp_path / "templates" / "one.c.jinja").write_text("x = {{ x }};", encoding="utf-8")
    return tmp_path / "templates"


def rendered(folder, made_by="test"):
    """Return the text of the template, and whether its Python was generated anew."""
    calls = []

    class Environment(jinja2.Environment):
        def _generate(self, *args, **options):
            calls.append(1)
            return super()._generate(*args, **options)

    environment = Environment(loader=jinja2.FileSystemLoader(folder),
                              bytecode_cache=Bytecode(made_by))
    return environment.get_template("one.c.jinja").render(x=3), bool(calls)


def kept(folder):
    return [path for path in (folder.parent / "bytecode").rglob("*") if path.is_file()]


def test_a_template_is_compiled_once(folder):
    assert rendered(folder) == ("x = 3;", True)
    assert rendered(folder) == ("x = 3;", False)
    assert [path.suffix for path in kept(folder)] == [".pyc"]


def test_another_text_or_environment_is_compiled_anew(folder):
    rendered(folder)
    assert rendered(folder, "another") == ("x = 3;", True)
    (folder / "one.c.jinja").write_text("y = {{ x }};", encoding="utf-8")
    assert rendered(folder, "another") == ("y = 3;", True)
    assert rendered(folder, "another") == ("y = 3;", False)


def test_damaged_bytecode_is_not_loaded(folder):
    rendered(folder)
    (path,) = kept(folder)
    intact = path.read_bytes()
    for damaged in (b"", intact[:7], intact[:-1], intact[:-9] + b"\0" + intact[-8:],
                    b"?" + intact[1:]):
        path.write_bytes(damaged)
        assert rendered(folder) == ("x = 3;", True)
        assert path.read_bytes() == intact


def test_where_nothing_may_be_written_it_is_compiled_each_time(folder, monkeypatch):
    monkeypatch.setattr(sys, "pycache_prefix", str(folder / "one.c.jinja"))  # a file
    assert rendered(folder) == rendered(folder) == ("x = 3;", True)
    monkeypatch.setattr(sys, "pycache_prefix", str(folder.parent / "bytecode"))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    assert rendered(folder) == rendered(folder) == ("x = 3;", True)
    assert not kept(folder)


def test_a_disk_that_fills_leaves_nothing(folder, monkeypatch):
    def full(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    assert rendered(folder) == ("x = 3;", True)
    assert not kept(folder)
