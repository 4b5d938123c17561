"""Compilers and the cache: no compiler, a broken one, killed builds, many at once, damage, keys."""

from __future__ import annotations

import errno
import importlib.util
import os
import random
import re
import shutil
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

import gyrospark as gs
from gyrospark import api
from gyrospark.generator import fingerprint
from gyrospark.generator.spec import Spec
from gyrospark.runtime.compilation import build_cache, compiler, stepper_module
from processes import FAST_TOP, PATIENCE, ROOT, call, cli, environment

BUILD = FAST_TOP + """
step = gs.stepper("IMS")
print(*step.integrate(top.q0, top.p0, dt=1e-3, steps=5, parameters=parameters).q[-1].tolist())
"""


def files_of(scheme="IMS"):
    return api.files_of(Spec(scheme))


def needs_cc():
    if shutil.which("cc") is None:
        pytest.skip("cc is not installed")


@pytest.fixture(autouse=True)
def own_cache(monkeypatch, tmp_path):
    """Every test here has a cache of its own, and is about files, not speed."""
    monkeypatch.setenv("GYROSPARK_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("GYROSPARK_OPTIMISE", "0")
    monkeypatch.delenv("CC", raising=False)
    return tmp_path / "cache"


@pytest.fixture
def script(tmp_path):
    """Return a function that writes a shell script and returns its path."""
    def write(text, name="mycc"):
        path = tmp_path / name
        path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
        path.chmod(0o755)
        return path
    return write


@pytest.fixture
def quick(script):
    """Return a compiler that does not optimise, for tests of files and not of speed."""
    needs_cc()
    return str(script('exec cc "$@" -O0', "quick"))


def kept(folder):
    """Return the modules in a cache folder."""
    return sorted(p for p in folder.glob("*") if p.suffix == ".so") if folder.is_dir() else []


def build(folder, cc=None):
    """Build and step in a new process; return its exit code and output."""
    return call([sys.executable, "-c", BUILD], GYROSPARK_CACHE=str(folder), CC=cc,
                GYROSPARK_OPTIMISE="0")


# ---------------------------------------------------------------- which compiler


def test_without_a_compiler_the_cure_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "ziglang", None)
    with pytest.raises(gs.errors.CompilerError) as caught:
        compiler.find_compiler()
    for word in ("gcc", "clang", "CC", "ziglang"):
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_pypi_compiler_is_the_last_choice(monkeypatch, tmp_path, script):
    """Compilers on PATH come before PyPI, CC before PATH."""
    monkeypatch.setenv("PATH", str(tmp_path))
    if importlib.util.find_spec("ziglang") is not None:
        assert compiler.find_compiler().command == (sys.executable, "-m", "ziglang", "cc")
    path = script("echo mine 1.0", "clang")
    assert compiler.find_compiler() == compiler.Compiler((str(path),), "mine 1.0")
    chosen = script("echo other 2.0", "other")
    monkeypatch.setenv("CC", f"{chosen} -pipe")
    assert compiler.find_compiler() == compiler.Compiler((str(chosen), "-pipe"), "other 2.0")
    monkeypatch.setenv("CC", "  ")
    assert compiler.find_compiler().version == "mine 1.0"


@pytest.mark.parametrize(("chosen", "words"), [
    ("/nonexistent", ["CC='/nonexistent'", "start", os.strerror(errno.ENOENT)]),
    ("false", ["CC='false'", "exit code 1"]),
    ("/", ["CC='/'", "start", os.strerror(errno.EACCES)]),
    ("gcc 'x", ["gcc 'x", "quotation"]),
    ("/dev/null", ["CC='/dev/null'", "start"]),
    ("/opt/my gcc/bin/gcc", ["CC='/opt/my gcc/bin/gcc'", "start", "quote"]),
])
def test_unusable_cc_is_reported(chosen, words, monkeypatch, own_cache):
    monkeypatch.setenv("CC", chosen)
    with pytest.raises(gs.errors.CompilerError) as caught:
        stepper_module.load_module("heavy_top_ims_gamma", files_of())
    for word in [*words, "set CC"]:
        assert word in str(caught.value)
    assert not kept(own_cache)


@pytest.mark.parametrize(("body", "words"), [
    ("echo 'bad day' >&2; exit 7", ["exit code 7", "bad day", "-Werror"]),
    ("printf 'bad \\377 byte' >&2; exit 7", ["exit code 7", "bad", "byte"]),
    ("exit 0", ["made no", "heavy_top_ims_gamma"]),
    ("kill -9 $$", ["signal 9"]),
    ("for last; do :; done; echo nonsense > $last", ["load", "CC"]),
], ids=["complains", "not UTF-8", "does nothing", "killed", "makes nonsense"])
def test_failing_compiler_is_quoted(body, words, monkeypatch, script, own_cache):
    """The error has command and stderr; nothing stays in the cache that would be loaded."""
    path = script(f'[ "$1" = --version ] && {{ echo mine; exit 0; }}\n{body}')
    monkeypatch.setenv("CC", str(path))
    with pytest.raises(gs.errors.CompilerError) as caught:
        stepper_module.load_module("heavy_top_ims_gamma", files_of())
    for word in words:
        assert word in str(caught.value)
    assert caught.value.command[0] == str(path)
    if "day" in body:
        assert caught.value.stderr == "bad day\n"
        assert str(path) in str(caught.value)
    assert not list(own_cache.glob("*build-*"))
    with pytest.raises(gs.errors.CompilerError):
        stepper_module.load_module("heavy_top_ims_gamma", files_of())


def test_a_gcc_that_makes_no_object_is_reported(monkeypatch, script, own_cache):
    """The objects of gcc itself are read before they are linked."""
    monkeypatch.setenv("CC", str(script('echo "gcc, Free Software Foundation"')))
    with pytest.raises(gs.errors.CompilerError, match="made no"):
        stepper_module.load_module("heavy_top_ims_gamma", files_of())
    assert not kept(own_cache)


def test_compiler_gets_no_input(monkeypatch, script):
    """The compiler has no input: one that reads stdin ends instead of waiting for the terminal."""
    path = script("cat; exit 1")
    monkeypatch.setenv("CC", str(path))
    with pytest.raises(gs.errors.CompilerError, match="exit code 1"):
        compiler.find_compiler()


def test_warnings_of_the_kernel_are_errors():
    """An unused variable in the C of a stepper ends its compilation."""
    needs_cc()
    files = dict(files_of())
    name = "heavy_top_ims_gamma"
    files[f"{name}.c"] += "\nstatic inline int two(void) { int unused = 1; return 2; }\n"
    with pytest.raises(gs.errors.CompilerError, match="unused") as caught:
        stepper_module.load_module(name, files)
    assert "-Wall" in caught.value.command


# ---------------------------------------------------------------- folders that cannot be used


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Return the files of a module and its checksum, compiled once."""
    if shutil.which("cc") is None:
        pytest.skip("cc is not installed")
    folder = tmp_path_factory.mktemp("built")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GYROSPARK_CACHE", str(folder))
        patch.setenv("GYROSPARK_OPTIMISE", "0")
        patch.setenv("CC", "cc")
        stepper_module.load_module("heavy_top_ims_gamma", files_of())
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.suffix in (".so", ".json")}


@pytest.fixture
def ready(built, monkeypatch):
    """Replace compilations by a copy of that module, for tests of where it is stored."""
    def compiled(name, files, compiler, folder, module_kind):
        (module,) = (data for file, data in built.items() if file.endswith(".so"))
        (folder / "module.so").write_bytes(module)
        return folder / "module.so", {"flags": [], "kernels": {}, "left_out": []}

    monkeypatch.setattr(stepper_module, "compile_verified", compiled)


@pytest.mark.parametrize("folder", ["/dev/null", "/dev/null/x", "/proc", "/proc/x", "file",
                                    "file/x"])
@pytest.mark.usefixtures("ready")
def test_a_temporary_folder_replaces_one_that_cannot_be_used(
    folder, monkeypatch, tmp_path, quick
):
    """One warning names the folder; the temporary one lasts as long as the process."""
    (tmp_path / "file").touch()
    folder = str(tmp_path / folder)
    monkeypatch.setenv("GYROSPARK_CACHE", folder)
    monkeypatch.setenv("CC", quick)
    monkeypatch.setattr(build_cache, "_IN_PLACE", {})
    ended = []
    monkeypatch.setattr("atexit.register", lambda *call, **options: ended.append((call, options)))
    with pytest.warns(gs.errors.InputWarning, match="GYROSPARK_CACHE") as caught:
        stepper_module.load_module("heavy_top_ims_gamma", files_of())
    assert folder in str(caught[0].message)
    assert caught[0].filename == __file__
    assert len(build_cache.entries()) == 2
    build_cache.write_cache("x", [1])  # with no further warning
    assert build_cache.read_cache("x") == [1]
    temporary = build_cache.cache_folder()
    assert temporary.stat().st_mode & 0o77 == 0
    for (function, *arguments), options in ended:
        function(*arguments, **options)
    assert not temporary.exists()


@pytest.fixture
def small_disk(tmp_path):
    """Return a function that mounts a file system of some KiB."""
    disk = tmp_path / "disk"
    disk.mkdir()

    def mount(size):
        if call(["mount", "-t", "tmpfs", "-o", f"size={size}k", "none", disk]).returncode:
            pytest.skip("mounting a small file system is not allowed here")
        return disk

    yield mount
    call(["umount", "-l", disk])


@pytest.mark.parametrize("size", [60, *(pytest.param(size, marks=pytest.mark.slow)
                                        for size in (4, 20, 120))])
def test_full_cache_is_reported(size, small_disk, quick, monkeypatch):
    """Wherever in the build the disk fills up, the error says so, and nothing is left to load."""
    disk = small_disk(size)
    monkeypatch.setenv("GYROSPARK_CACHE", str(disk))
    monkeypatch.setenv("CC", quick)
    with pytest.raises((build_cache.CacheError, gs.errors.CompilerError), match="space"):
        stepper_module.load_module("heavy_top_ims_gamma", files_of())
    assert not list(disk.glob("*build-*"))
    call(["mount", "-o", "remount,size=2m", disk])
    assert stepper_module.load_module("heavy_top_ims_gamma", files_of())


@pytest.mark.slow  # five processes; a temporary folder replaces a read-only one above
def test_read_only_cache_serves_what_it_has(small_disk, quick):
    disk = small_disk(2000)
    first = build(disk, quick)
    assert first.returncode == 0, first.stderr
    if call(["mount", "-o", "remount,ro", disk]).returncode:
        pytest.skip("remounting is not allowed here")
    assert build(disk, quick).stdout == first.stdout
    done = cli("run", "fast-top", "--scheme", "EMS", "--dt", "1e-3", "--steps", "1", CC=quick,
               GYROSPARK_CACHE=str(disk))
    assert (done.returncode, done.stderr.count("\n")) == (0, 1)  # a temporary folder stands in
    assert "Read-only" in done.stderr
    assert "GYROSPARK_CACHE" in done.stderr
    done = cli("cache", "clear", GYROSPARK_CACHE=str(disk))
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


# ---------------------------------------------------------------- killed, at once, damaged


@pytest.mark.slow  # processes that are killed
def test_killed_builds_leave_nothing_that_is_loaded(own_cache, quick):
    """SIGKILL ends builds at random instants; the next one succeeds."""
    rng = random.Random(2026)
    reference = None
    started = time.monotonic()
    assert build(own_cache.with_name("timing"), quick).returncode == 0
    duration = time.monotonic() - started
    for _ in range(40):
        shutil.rmtree(own_cache, ignore_errors=True)
        process = subprocess.Popen([sys.executable, "-c", BUILD], stdout=subprocess.PIPE,
                                   stderr=subprocess.PIPE, start_new_session=True,
                                   env=environment(GYROSPARK_CACHE=str(own_cache), CC=quick,
                                                   TMPDIR=str(own_cache.parent)))
        time.sleep(rng.uniform(0.2, 1.0) * duration)
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate(timeout=PATIENCE)
        for path in kept(own_cache):  # appeared whole or not at all
            assert path.read_bytes().startswith(b"\x7fELF")
            if path.with_name(path.name + ".json").is_file():
                assert stepper_module._record(path)
        if rng.random() < 0.3:
            done = build(own_cache, quick)
            assert done.returncode == 0, done.stderr
            reference = reference or done.stdout
            assert done.stdout == reference
    done = build(own_cache, quick)
    assert done.returncode == 0, done.stderr
    assert len(kept(own_cache)) == 1


@pytest.mark.slow  # processes; test_threads_and_processes.py has threads that build one stepper
def test_many_processes_at_once(own_cache, quick):
    """All processes build the same stepper cold and get the same bits; one module stays."""
    processes = [
        subprocess.Popen([sys.executable, "-c", BUILD], stdout=subprocess.PIPE, text=True,
                         stderr=subprocess.PIPE,
                         env=environment(GYROSPARK_CACHE=str(own_cache), CC=quick))
        for _ in range(16)
    ]
    outputs = [process.communicate(timeout=PATIENCE) for process in processes]
    assert [p.returncode for p in processes] == [0] * 16, [stderr for _, stderr in outputs]
    assert len({stdout for stdout, _ in outputs}) == 1
    assert not any(stderr for _, stderr in outputs)
    (only,) = kept(own_cache)
    assert stepper_module._record(only)
    assert not list(own_cache.glob("*build-*"))


DAMAGE = {
    "empty": lambda b: b"",
    "text": lambda b: b"not a module\n",
    "first kilobyte": lambda b: b[:1000],
    "first half": lambda b: b[: len(b) // 2],
    "all but a page": lambda b: b[:-4096],
    "zeros within": lambda b: b[: len(b) // 2] + bytes(4096) + b[len(b) // 2 + 4096:],
    "one bit": lambda b: b[: len(b) // 3] + bytes([b[len(b) // 3] ^ 1]) + b[len(b) // 3 + 1:],
}


@pytest.mark.usefixtures("ready")
@pytest.mark.parametrize("damage", [*DAMAGE, "no checksum", "other checksum", "empty checksum"])
def test_a_damaged_module_is_built_anew(damage, built, own_cache, monkeypatch):
    """A damaged module is not even loaded, which would end the process with a bus error."""
    proofs = {"no checksum": None, "other checksum": b"0" * 64, "empty checksum": b"\xff"}
    own_cache.mkdir()
    for name, data in built.items():
        if name.endswith(".so"):
            (own_cache / name).write_bytes(DAMAGE.get(damage, lambda b: b)(data))
        elif (content := proofs.get(damage, data)) is not None:
            (own_cache / name).write_bytes(content)
    (module,) = kept(own_cache)
    assert not stepper_module._record(module)
    monkeypatch.setenv("CC", "cc")
    loaded = stepper_module.load_module("heavy_top_ims_gamma", files_of())
    assert loaded.lib.heavy_top_ims_gamma_step
    assert kept(own_cache) == [module]
    assert stepper_module._record(module)


def test_whole_module_is_used_as_it_is(built, own_cache, monkeypatch):
    """A hit starts no compiler but for its version."""
    own_cache.mkdir()
    for name, data in built.items():
        (own_cache / name).write_bytes(data)
    monkeypatch.setenv("CC", "cc")
    monkeypatch.setattr(stepper_module, "compile_verified", lambda *_: pytest.fail("compiled"))
    loaded = stepper_module.load_module("heavy_top_ims_gamma", files_of())
    assert loaded.lib.heavy_top_ims_gamma_step


@pytest.mark.parametrize("content", [b"", b"[]", b'{"a": 1}', b"\xff"])
def test_damaged_source_is_derived_anew(content, own_cache):
    spec = Spec("IMS", real="float")
    own_cache.mkdir()
    path = own_cache / api.Derivation(spec).key("")
    path.write_bytes(content)
    files = api.files_of(spec)
    assert set(files) == {f"{spec.name}.{end}" for end in ("h", "c", "json")}
    assert path.read_bytes() != content
    assert api.files_of(spec) == files


def test_kept_text_is_given_back_as_it_was_written_or_not_at_all(own_cache):
    """A flipped bit in the C of a stored source does not become another stepper."""
    content = {"a.c": "x = 0.25;", "a.json": "{}"}
    assert build_cache.read_cache("a.source.json") is None
    build_cache.write_cache("a.source.json", content)
    assert build_cache.read_cache("a.source.json") == content
    path = own_cache / "a.source.json"
    sound = path.read_bytes()
    for index in range(len(sound)):
        damaged = bytearray(sound)
        damaged[index] ^= 1
        path.write_bytes(damaged)
        assert build_cache.read_cache("a.source.json") in (None, content), index


# ---------------------------------------------------------------- manifests


@pytest.mark.parametrize(("old", "new", "words"), [
    ('"unknowns": 9', '"unknowns": 8', "unknowns 8 against 9"),
    ('"real": "double"', '"real": "float"', "real 'float' against 'double'"),
    ('"q3"', '"q3", "q4"', "damaged"),
    ('"q0**2 + q1**2 + q2**2 + q3**2 - 1"', "", "constraints 0 against 1"),
    ('"mgl": "real"', '"mgl": "complex"', "damaged"),
    ('"order": 2', '"order": "2"', "damaged"),
    ('"schema"', "schema", "damaged"),
])
def test_manifest_of_another_stepper_is_refused(old, new, words):
    """The sizes in a manifest belong to the memory that compiled code writes to."""
    files = dict(files_of())
    name = "heavy_top_ims_gamma.json"
    assert old in files[name]
    files[name] = files[name].replace(old, new, 1)
    with pytest.raises(gs.InputError, match=words):
        gs.Stepper("heavy_top_ims_gamma", files)


# ---------------------------------------------------------------- keys


def test_key_depends_on_everything_that_changes_the_binary(monkeypatch):
    files = files_of()
    cc = compiler.Compiler(("cc",), "cc 1.0")
    keys = [build_cache.binary_key(files, cc)]
    assert build_cache.binary_key(dict(reversed(files.items())), cc) == keys[0]
    for name in files:
        keys.append(build_cache.binary_key(files | {name: files[name] + " "}, cc))
    keys.append(build_cache.binary_key(files, compiler.Compiler(("clang",), "cc 1.0")))
    keys.append(build_cache.binary_key(files, compiler.Compiler(("cc", "-m32"), "cc 1.0")))
    keys.append(build_cache.binary_key(files, compiler.Compiler(("cc",), "cc 1.1")))
    for owner, name, value in ((build_cache, "cpu_description", lambda: "another CPU"),
                               (compiler.Compiler, "flags", property(lambda self: ["-O0"])),
                               (build_cache, "extension_suffix", lambda: ".another-python.so"),
                               (build_cache.cffi, "__version__", "99")):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, value)
            keys.append(build_cache.binary_key(files, cc))
    assert len(set(keys)) == len(keys)
    assert build_cache.binary_key(files, cc) == keys[0]
    assert all(re.fullmatch("[0-9a-f]{32}", key) for key in keys)


def test_source_key_depends_on_the_generator(monkeypatch, tmp_path):
    """The key changes with the text of the generator or a template, and with the version."""
    spec = Spec("IMS", real="float")
    for folder in ("core", "generator", "engine", "templates"):
        shutil.copytree(ROOT / folder, tmp_path / folder,
                        ignore=shutil.ignore_patterns("__pycache__"))

    def key(spec=spec):
        fingerprint.generator_fingerprint.cache_clear()
        return api.Derivation(spec).key("")

    own_key = key()
    with monkeypatch.context() as patch:
        patch.setattr(fingerprint, "ROOT", tmp_path)
        keys = [key()]
        assert keys == [own_key]
        for path in (tmp_path / "templates" / "stepper.c.jinja",
                     tmp_path / "engine" / "gyrospark" / "engine.h",
                     tmp_path / "generator" / "tableaux" / "nodes.py",
                     tmp_path / "core" / "real_types.py"):
            path.write_text(path.read_text(encoding="utf-8") + "\n", encoding="utf-8")
            keys.append(key())
        (tmp_path / "engine" / "gyrospark" / "engine.h").unlink()
        keys.append(key())
        patch.setattr(fingerprint, "__version__", "99")
        keys.append(key())
        keys.append(key(Spec("IMS", None, "alpha", real="float")))
    assert len(set(keys)) == len(keys)
    assert key() == own_key


# ---------------------------------------------------------------- listing and clearing


def test_clearing_touches_only_what_is_ours(own_cache):
    """GYROSPARK_CACHE may have been set to a folder that is used for something else."""
    assert build_cache.entries() == []  # of no folder, which is not made
    assert build_cache.clear() == 0
    own_cache.mkdir()
    key = "0123456789abcdef" * 2
    cached = [f"heavy_top_ims_gamma-{key}.cpython-311-x86_64-linux-gnu.so",
              f"heavy_top_ims_gamma-{key}.cpython-311-x86_64-linux-gnu.so.json",
              f"heavy_top_ims_gamma-{key}.cp312-win_amd64.pyd",
              f"heavy_top_ims_gamma-{key}.cp312-win_amd64.pyd.json",
              f"heavy_top_gl8_alpha-{key}.source.json"]
    foreign = ["thesis.tex", ".bashrc", "notes-1.source.json", "lib.so", f"{key}.so", "build-log",
               f"kernel-{key}.so"]
    for name in [*cached, *foreign]:
        (own_cache / name).touch()
    (own_cache / "folder").mkdir()
    assert [p.name for p in build_cache.entries()] == sorted(cached)
    assert build_cache.clear() == len(cached)
    assert {p.name for p in own_cache.iterdir()} == {*foreign, "folder"}


def left(name, hours, mark=build_cache._MARKED):
    """Create a build's folder that is so many hours old."""
    name.mkdir(parents=True)
    (name / "kernel.o").touch()
    if mark is not None:
        (name / build_cache._MARK).write_text(mark)
    then = time.time() - hours * 3600
    os.utime(name, (then, then))


@pytest.mark.usefixtures("ready")
def test_old_build_folders_are_swept_up(own_cache, quick, monkeypatch):
    """Folders of killed builds go a day later, or when the cache is cleared; not earlier."""
    monkeypatch.setenv("CC", quick)
    for name, hours in (("oldbuild", 30), ("newbuild", 2), ("nowbuild", 0)):
        left(own_cache / f"gyrospark-build-{name}", hours)
    stepper_module.load_module("heavy_top_ims_gamma", files_of())
    assert {p.name[-8:] for p in own_cache.glob("*build-*")} == {"newbuild", "nowbuild"}
    build_cache.clear()
    assert {p.name[-8:] for p in own_cache.glob("*build-*")} == {"nowbuild"}


def test_folders_of_others_are_never_removed(own_cache, tmp_path):
    """Old folders stay that have other names, no mark, another mark, a link or another owner."""
    for name, mark in (("build-arm64", build_cache._MARKED), ("build-arm64/src", None),
                       ("gyrospark-build-notmarkd", None), ("gyrospark-build-otherwis", "mine"),
                       ("gyrospark-build-arm64-release", build_cache._MARKED)):
        left(own_cache / name, 1000, mark)
    foreign = {*own_cache.rglob("*")}
    left(tmp_path / "gyrospark-build-elsewher", 1000)
    (own_cache / "gyrospark-build-linkedto").symlink_to(tmp_path / "gyrospark-build-elsewher")
    foreign |= {own_cache / "gyrospark-build-linkedto", *tmp_path.rglob("gyrospark-build-else*/*")}
    if os.geteuid() == 0:
        left(own_cache / "gyrospark-build-foreigns", 1000)
        os.chown(own_cache / "gyrospark-build-foreigns", 12345, 12345)
        foreign |= {*own_cache.rglob("gyrospark-build-foreigns/*")}
    left(own_cache / "gyrospark-build-reallyus", 1000)
    with build_cache.build_folder() as folder:
        assert build_cache._BUILD_NAME.fullmatch(folder.name)
        assert [p.name for p in folder.iterdir()] == [build_cache._MARK]
    build_cache.clear()
    assert all(path.exists() for path in foreign)
    assert not (own_cache / "gyrospark-build-reallyus").exists()


# ---------------------------------------------------------------- what other users could write


def publish_both(own_cache, quick, monkeypatch):
    """Build a module and store a text; return their files, which nobody else may write to.

    This holds for any umask: with 002, of groups of one user, the group could write to files.
    """
    monkeypatch.setenv("CC", quick)
    before = os.umask(0o000)
    try:
        stepper_module.load_module("heavy_top_ims_gamma", files_of())
        build_cache.write_cache("text.source.json", ["text"])
    finally:
        os.umask(before)
    (built,), text = kept(own_cache), own_cache / "text.source.json"
    for path in (own_cache, built, text):
        assert not path.stat().st_mode & 0o022
        assert build_cache.untrusted_writers(path) == ""
    return built, text


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such modes")
@pytest.mark.usefixtures("ready")
@pytest.mark.parametrize("planted", ["group writes", "others write", "link", "other owner"])
def test_planted_files_are_not_read(planted, own_cache, quick, monkeypatch, tmp_path):
    """No file is loaded or compiled if another user could have written it."""
    for path in publish_both(own_cache, quick, monkeypatch):
        if planted == "link":
            path.rename(tmp_path / path.name)
            path.symlink_to(tmp_path / path.name)
        elif planted == "other owner":
            if os.geteuid() != 0:
                pytest.skip("only root gives files away")
            os.chown(path, 12345, 12345)
        else:
            path.chmod(0o764 if planted == "group writes" else 0o746)
        assert build_cache.untrusted_writers(path) != ""
        assert not stepper_module._record(path)
    assert build_cache.read_cache("text.source.json") is None
    monkeypatch.setattr(stepper_module, "compile_verified", lambda *_: pytest.fail("built anew"))
    with pytest.raises(pytest.fail.Exception, match="built anew"):
        stepper_module.load_module("heavy_top_ims_gamma", files_of())


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such modes")
@pytest.mark.usefixtures("ready")
@pytest.mark.parametrize(("mode", "above", "owner", "trusted"), [
    (0o700, 0o755, None, True), (0o1777, 0o755, None, True), (0o755, 0o1777, None, True),
    (0o755, 0o775, None, True), (0o777, 0o755, None, False), (0o775, 0o755, None, False),
    (0o755, 0o777, None, False), (0o700, 0o755, 12345, False)])
def test_folders_that_others_can_write_to(mode, above, owner, trusted, own_cache, quick,
                                          monkeypatch, tmp_path):
    """In a sticky folder others cannot replace our files."""
    built, text = publish_both(own_cache, quick, monkeypatch)
    if owner is not None and os.geteuid() != 0:
        pytest.skip("only root gives files away")
    own_cache.chmod(mode)
    tmp_path.chmod(above)
    if owner is not None:
        os.chown(own_cache, owner, owner)
    assert bool(stepper_module._record(built)) is trusted
    assert (build_cache.read_cache(text.name) == ["text"]) is trusted
    if trusted:
        with build_cache.build_folder():
            return
    monkeypatch.setattr(build_cache, "_IN_PLACE", {})
    with pytest.warns(gs.errors.InputWarning, match="GYROSPARK_CACHE"):
        folder = build_cache._usable(own_cache)
    assert folder == build_cache.cache_folder() != own_cache
    assert not build_cache.untrusted_writers(folder)


def test_cache_folder_is_the_users(monkeypatch, tmp_path):
    """The folder is the chosen or the default one; others can read neither it nor builds in it."""
    assert build_cache.cache_folder() == tmp_path / "cache"
    monkeypatch.delenv("GYROSPARK_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    if sys.platform == "linux":
        assert build_cache.cache_folder() == tmp_path / "xdg" / "gyrospark"
    monkeypatch.setenv("GYROSPARK_CACHE", "")
    assert build_cache.cache_folder().name == "gyrospark"
    with build_cache.build_folder() as private:
        assert Path(private).parent == build_cache.cache_folder()
        for folder in (private, build_cache.cache_folder()):
            assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert not private.exists()


def test_levels_of_optimisation(monkeypatch):
    """Each level has its own flags, and so its own modules; an unknown level is refused."""
    flags, lower = [], []
    for level in ("1", "3", ""):
        monkeypatch.setenv("GYROSPARK_OPTIMISE", level)
        flags.append(compiler.find_compiler().flags)
        gcc = compiler.Compiler(("cc",), "cc 12\nCopyright (C) 2022 Free Software Foundation, Inc.")
        lower.append(gcc.lower_flags)
        assert not compiler.Compiler(("cc",), "clang version 16").lower_flags
    assert flags[0][0] == "-O1"
    assert flags[1] == flags[2] != flags[0]
    assert not lower[0]  # nothing lifts a low level
    assert lower[1] == lower[2] == compiler.LOWER_FLAGS
    monkeypatch.setenv("GYROSPARK_OPTIMISE", "fast")
    with pytest.raises(gs.InputError, match=r"GYROSPARK_OPTIMISE = 'fast'.*0, 1, 2 or 3"):
        compiler.find_compiler().flags  # noqa: B018
