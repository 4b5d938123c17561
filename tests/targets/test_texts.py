"""What targets write, to the byte: ``pytest tests/targets/test_texts.py --update`` after a change.

The files are compared as they are for a model with inputs and quantities, and by their hashes for
others. The generated C among them has tests of its own.
"""

from __future__ import annotations

import hashlib
import json

import pytest

import gyrospark as gs
from gyrospark.targets import TARGETS
from gyrospark.targets.artefact import MARKER
from processes import ROOT

DATA = ROOT / "tests" / "data" / "targets"
TEXTS = ("cpp", "rust", "octave", "arduino")
MODELS = {
    "satellite": {"system": ROOT / "examples" / "control_c" / "satellite.toml", "scheme": "G-L",
                  "stages": 2, "parameters": {"u1": 0.01, "u3": -0.02}},
    "top": {"system": "fast-top", "scheme": "EMS", "dt": 1e-3},
    "pendulum": {"system": ROOT / "examples" / "pendulum.toml", "scheme": "IMS"},
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return the texts of each target and model that no generated file has."""
    folder = tmp_path_factory.mktemp("artefacts")

    def texts(target, model):
        built = gs.build(target, **MODELS[model], out=folder / f"{target}_{model}")
        return {name: (built.path / name).read_text(encoding="utf-8") for name in built.files
                if name != MARKER and name.rpartition("/")[2] not in built.stepper.sources}

    return {(target, model): texts(target, model) for target in TEXTS for model in MODELS}


@pytest.mark.parametrize("target", TEXTS)
def test_texts_are_those_that_were_looked_at(written, target, request):
    texts = written[target, "satellite"]
    folder = DATA / target
    if request.config.getoption("--update"):
        for name, text in texts.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")
    assert {path.relative_to(folder).as_posix() for path in folder.rglob("*")
            if path.is_file()} == {*texts}
    for name, text in texts.items():
        assert text == (folder / name).read_text(encoding="utf-8"), name


def test_texts_of_other_models_stay_the_same(written, request):
    digests = {f"{target} {model}": {name: hashlib.sha256(text.encode()).hexdigest()[:16]
                                     for name, text in texts.items()}
               for (target, model), texts in written.items() if model != "satellite"}
    path = DATA / "digests.json"
    if request.config.getoption("--update"):
        path.write_text(json.dumps(digests, indent=2) + "\n", encoding="utf-8")
    assert digests == json.loads(path.read_text(encoding="utf-8"))


def test_every_target_is_listed_with_a_module():
    for name, target in TARGETS.items():
        module = target.load()
        assert target.name == name
        assert all(callable(getattr(module, what)) for what in ("files", "compile", "check"))
