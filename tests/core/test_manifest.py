"""Manifests are read from JSON and written again to the byte; a refusal names the wrong entry."""

from __future__ import annotations

import copy
import json
import pickle
from contextlib import suppress

import pytest

import gyrospark as gs
import systems
from gyrospark.api import text_of
from gyrospark.core.errors import InputError
from gyrospark.core.json_records import UnfitError
from gyrospark.core.manifest import Manifest
from gyrospark.generator.spec import Spec
from gyrospark.runtime.compilation.manifest import read_manifest
from processes import ROOT

#: Between them these have every key but keys of velocity constraints and symmetries.
NAMES = ("heavy_top", "double_top", "pushed_pendulum", "dragged_pendulum", "bead", "lagrangian")
#: Parts whose keys are names.
NAMED = ("bodies", "joints", "constraints", "operations", "quantities", "parameters")
#: A value of each type of JSON.
VALUES = (None, True, 7, 0.5, "x", [], [3.5], {}, {"x": 3.5})


def contents():
    """Yield the manifests of steppers, and of one of profile control."""
    for name in NAMES:
        yield json.loads(systems.stepper(name).manifest.text)
    files, _ = text_of(Spec("G-L", 2).with_profile("control"), gs.models.satellite())
    yield json.loads(next(text for name, text in files.items() if name.endswith(".json")))


def places(content, path=()):
    """Yield the path of every value, of lists and of names the first."""
    if path:
        yield path
    inner = [*content.items()] if isinstance(content, dict) else (
        [*enumerate(content)][:1] if isinstance(content, list) else [])
    for key, value in inner[:1] if path and path[-1] in NAMED else inner:
        yield from places(value, (*path, key))


def changed(content, path, value):
    copied = copy.deepcopy(content)
    *above, last = path
    entry = copied
    for key in above:
        entry = entry[key]
    entry[last] = value
    return copied


@pytest.mark.parametrize("path", sorted((ROOT / "generated").glob("*.json")), ids=lambda p: p.stem)
def test_text_is_read_and_written_to_the_byte(path):
    text = path.read_text(encoding="utf-8")
    assert Manifest.from_text(text).text == text


@pytest.mark.parametrize(("part", "key", "value"), [
    ("scheme", "unknowns", 11), ("scheme", "order", 4), ("scheme", "multipliers", 3),
    ("system", "coordinates", ["q0", "q1", "q2"])])
def test_a_manifest_of_another_header_is_refused(part, key, value):
    """The compiled code would read and write beyond arrays of other sizes."""
    name = "heavy_top_ims_gamma"
    files = {path.name: path.read_text("utf-8") for path in (ROOT / "generated").glob(f"{name}.*")}
    assert read_manifest(name, files).text == files[f"{name}.json"]
    changed = json.loads(files[f"{name}.json"])
    assert changed[part][key] != value
    changed[part][key] = value
    with pytest.raises(InputError):
        read_manifest(name, files | {f"{name}.json": json.dumps(changed)})


def test_every_key_comes_back():
    for content in contents():
        assert Manifest.from_json(content).as_json() == content


def test_a_value_of_another_type_is_refused_or_comes_back():
    """Each entry of some manifests is replaced by a value of each type."""
    tried = accepted = 0
    for content in contents():
        for path in places(content):
            for value in VALUES:
                spoilt = changed(content, path, value)
                tried += 1
                with suppress(UnfitError):
                    rewritten = Manifest.from_json(spoilt).as_json()
                    # A text for a text; an empty value, of a key that may be absent.
                    assert rewritten == spoilt or not value
                    accepted += 1
    assert tried - accepted > 500


def changed_to_absent(content, path):
    copied = copy.deepcopy(content)
    entry = copied
    for key in path[:-1]:
        entry = entry[key]
    del entry[path[-1]]
    return copied


def test_unknown_and_missing_keys_are_named():
    content = systems.stepper("heavy_top").manifest.as_json()
    with pytest.raises(UnfitError, match="'more'"):
        Manifest.from_json(content | {"more": 1})
    for path in (("system", "name"), ("scheme", "order"), ("real",)):
        with pytest.raises(UnfitError, match=path[-1]):
            Manifest.from_json(changed_to_absent(content, path))


def test_a_manifest_is_copied_and_pickled():
    manifest = systems.stepper("double_top").manifest
    for copied in (copy.deepcopy(manifest), pickle.loads(pickle.dumps(manifest))):
        assert copied == manifest
        assert copied.text == manifest.text
