"""Files of the project for forges and tools: hosted CI, pre-commit, citation."""

from __future__ import annotations

import re
import sys
import tomllib

import pytest

import gyrospark as gs
from processes import HELPERS, ROOT, call

yaml = pytest.importorskip("yaml", reason="YAML is read by PyYAML, which the extra cluster brings")

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def read(name: str):
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def recipe(target: str) -> list[str]:
    """Return the commands of make for a target, as words, without the folder of programs."""
    lines = re.search(rf"^{target}:.*\n((?:\t.*\n)+)", MAKEFILE, flags=re.MULTILINE)[1]
    lines = re.sub(r"#.*", "", lines).replace("\\\n", " ").replace("$(BIN)/", "")
    return [" ".join(line.split()) for line in lines.splitlines()]


@pytest.fixture(scope="module")
def jobs():
    return read(".github/workflows/ci.yml")["jobs"]


def commands(job) -> list[str]:
    """Return each line that a job runs."""
    return [" ".join(line.replace(".venv/Scripts/", "").split())
            for step in job["steps"] for line in step.get("run", "").splitlines()]


def test_hosted_ci_calls_the_commands_of_the_readme(jobs):
    run = commands(jobs["unix"])
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for command in ("make demo", "make test"):
        assert command in run
        assert re.search(rf"^{command} ", readme, flags=re.MULTILINE)


def test_without_make_it_does_what_make_does(jobs):
    run = commands(jobs["windows"])
    assert recipe("demo")[0] in run
    assert recipe("quick")[0] in run
    assert recipe("lint")[0] in run


def test_hosted_ci_has_the_systems_pythons_and_compilers(jobs):
    matrix = jobs["unix"]["strategy"]["matrix"]
    assert {*matrix["os"], jobs["windows"]["runs-on"]} == {
        "ubuntu-latest", "macos-latest", "windows-latest"}
    assert matrix["python"] == ["3.11", "3.12", "3.13", "3.14"]
    assert PROJECT["requires-python"] == f">={matrix['python'][0]}"
    assert set(matrix["compiler"]) == {"gcc", "clang", "ziglang"}
    assert any("ziglang" in package for package in PROJECT["optional-dependencies"]["compiler"])


def test_a_job_has_the_packages_that_interop_and_targets_skip_without(jobs):
    run = commands(jobs["extras"])
    (install,) = (line for line in run if "pip install" in line)
    extras = re.search(r"\[(.*)\]", install)[1].split(",")
    assert {"jax", "torch", "casadi", "wasm"} == {*extras} <= {*PROJECT["optional-dependencies"]}
    (tests,) = (line for line in run if "pytest" in line)
    folders = [word for word in tests.split() if word.startswith("tests/")]
    assert folders == ["tests/interop", "tests/targets"]
    assert all((ROOT / folder).is_dir() for folder in folders)


def test_slow_tests_run_each_night():
    workflow = read(".github/workflows/nightly.yml")
    assert "schedule" in workflow[True]  # YAML reads "on" as true
    assert "make test-long" in commands(workflow["jobs"]["long"])
    assert "-m slow" in recipe("test-long")[0]


def test_pre_commit_calls_what_is_there():
    for repository in read(".pre-commit-config.yaml")["repos"]:
        assert repository["repo"] == "local"  # versions come from .venv
        for hook in repository["hooks"]:
            program, *words = hook["entry"].split()
            if program == "make":
                assert re.search(rf"^{words[0]}:", MAKEFILE, flags=re.MULTILINE)
            else:
                assert (ROOT / words[-1]).is_file()


def test_citation_is_of_this_version():
    citation = read("CITATION.cff")
    assert str(citation["version"]) == gs.__version__
    assert citation["license"] == PROJECT["license"]
    assert citation["title"] == PROJECT["name"]
    assert {"cff-version", "message", "authors"} <= citation.keys()
    assert citation["keywords"] == PROJECT["keywords"]


def test_the_archive_with_a_doi_has_the_same_description():
    citation, archive = read("CITATION.cff"), read(".zenodo.json")
    for key, archive_key in (("title", "title"), ("abstract", "description"),
                             ("license", "license"), ("keywords", "keywords")):
        assert citation[key].strip() == archive[archive_key].strip() if key == "abstract" else (
            citation[key] == archive[archive_key])
    assert archive["upload_type"] == "software"
    assert [author["name"] for author in citation["authors"]] == [
        author["name"] for author in archive["creators"]] == [
            author["name"] for author in PROJECT["authors"]]


def test_classifiers_are_the_pythons_of_ci(jobs):
    pythons = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if ":: 3." in line]
    assert pythons == jobs["unix"]["strategy"]["matrix"]["python"]


def test_a_release_is_published_without_a_password_and_after_all_was_built():
    jobs = read(".github/workflows/release.yml")["jobs"]
    assert jobs["pypi"]["permissions"] == {"id-token": "write"}
    assert {*jobs["pypi"]["needs"]} == {*jobs} - {"pypi", "pages"}
    assert "secrets" not in str(jobs)
    systems = {name.partition("-")[0] for name in jobs["wheels"]["strategy"]["matrix"]["os"]}
    assert systems == {"ubuntu", "macos", "windows"}
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["cibuildwheel"]
    steppers = settings["environment"]["GYROSPARK_PREBUILT"].split()
    assert all((ROOT / "generated" / f"{name}.c").is_file() for name in steppers)
    assert steppers == re.search(r'GYROSPARK_PREBUILT="([^"]*)"', (ROOT / "RELEASE.md").read_text(
        encoding="utf-8"))[1].split()


def test_the_conda_recipe_is_that_of_the_project():
    recipe_file = read("conda/meta.yaml")
    assert recipe_file["package"] == {"name": PROJECT["name"], "version": PROJECT["version"]}
    assert recipe_file["about"]["license"] == PROJECT["license"]
    assert recipe_file["about"]["summary"] == PROJECT["description"]
    in_project = {line.partition(";")[0].replace(" ", "") for line in PROJECT["dependencies"]}
    in_recipe = {line.replace(" ", "") for line in recipe_file["requirements"]["run"]}
    assert {*recipe_file["requirements"]["host"]} - {*recipe_file["requirements"]["run"]} == {
        "pip", "setuptools >=77"}
    assert in_recipe == in_project | {f"python{PROJECT['requires-python']}", "c-compiler"}
    assert dict(line.split(" = ")
                for line in recipe_file["build"]["entry_points"]) == PROJECT["scripts"]


def test_every_file_is_of_the_project():
    """No file has a notice of copyright besides the licence: text of others is not copied."""
    notice = re.compile(r"Copyright\s*(\(c\)|©|[12]\d{3})|SPDX-License|All rights reserved", re.I)
    folders = [ROOT / name for name in (
        "docs", "engine", "examples", "generator", "runtime", "targets", "templates", "tests")]
    endings = {".c", ".cpp", ".css", ".cu", ".h", ".hpp", ".html", ".jinja", ".js", ".json", ".m",
               ".rs", ".sdf", ".toml", ".urdf", ".xml"}
    files = [path for folder in folders for path in folder.rglob("*") if path.suffix in endings]
    assert len(files) > 200
    assert [path for path in files if notice.search(path.read_text(encoding="utf-8"))] == []


def test_the_folder_of_the_repository_may_have_any_name(tmp_path):
    root = tmp_path / "not-a-module"
    (root / "tests").mkdir(parents=True)
    (root / "__init__.py").write_text("raise AssertionError")
    (root / "tests" / "test_nothing.py").write_text("def test_nothing():\n    pass\n")
    command = [sys.executable, "-m", "pytest", "-p", "root_folder", "--rootdir", root,
               "--import-mode=importlib", "-p", "no:cacheprovider"]
    process = call(command, cwd=root, PYTHONPATH=str(HELPERS), PYTEST_DISABLE_PLUGIN_AUTOLOAD="1")
    assert process.returncode == 0, process.stdout
