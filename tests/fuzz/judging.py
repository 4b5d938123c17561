"""One input through one entrance: accepted, refused, or a failure; within its time."""

from __future__ import annotations

import atexit
import random
import shutil
import signal
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FrameType

from gyrospark.core.errors import InputWarning

__all__ = ["CORPUS", "Failure", "Verdict", "corpus", "judge", "random_input",
           "refuse_unless_sentence", "scratch", "shrunk"]

MEMORY = Path("/dev/shm")
STATM = Path("/proc/self/statm").exists()
CORPUS = Path(__file__).resolve().parent / "corpus"
Check = Callable[[bytes], str]


class HangError(BaseException):
    """The time of an input is over. No ``except Exception`` on the way shall stop it."""


@dataclass(frozen=True)
class Failure:
    """The kind of a failure, and its place: equal places count as one bug."""

    kind: str
    place: str
    text: str

    @property
    def key(self) -> str:
        return f"{self.kind} at {self.place}"


@dataclass(frozen=True)
class Verdict:
    """``outcome`` is "accepted", a kind of refusal, or "failed"."""

    outcome: str
    seconds: float
    failure: Failure | None = None


def judge(check: Check, data: bytes, limit: float) -> Verdict:
    """Return the verdict of an entrance on an input."""
    start = time.perf_counter()
    failure = None
    outcome = "failed"
    try:
        with time_limit(limit), memory_limit(), warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)  # strange inputs are remarked on
            outcome = check(data)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit, HangError and what no entrance expects
        failure = described(error)
    return Verdict(outcome, time.perf_counter() - start, failure)


def described(error: BaseException) -> Failure:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "/tests/" not in f.filename and "gyrospark" in f.filename]
    # A hang is caught wherever the clock finds it: its place is how it was entered.
    last = frames[-1] if not ours else ours[0] if isinstance(error, HangError) else ours[-1]
    return Failure(type(error).__name__, f"{Path(last.filename).name}:{last.lineno}",
                   "".join(traceback.format_exception(error))[-6000:])


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise ``HangError`` in this thread, the main one, after so many seconds."""
    def ring(number: int, frame: FrameType | None) -> None:
        raise HangError(f"no answer within {seconds:g} s")

    handler = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, handler)


@contextmanager
def memory_limit() -> Iterator[None]:
    """Let an input that asks for more than 4 GB fail by itself, instead of the machine."""
    try:
        import resource
    except ImportError:  # Windows
        yield
        return
    limits = resource.getrlimit(resource.RLIMIT_AS)
    size = int(Path("/proc/self/statm").read_text().split()[0]) if STATM else 0
    limit = size * resource.getpagesize() + 2**32
    if limits[1] != resource.RLIM_INFINITY:
        limit = min(limit, limits[1])
    resource.setrlimit(resource.RLIMIT_AS, (limit, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)


def random_input(name: str, seed: int, number: int) -> bytes:
    """Return the input of a number: the same in every run and process.

    One in eight is a file of the corpus with some of its bytes changed.
    """
    rng = random.Random(f"{name} {seed} {number}")
    files = corpus(name)
    if files and rng.random() < 0.125:
        content = bytearray(rng.choice(files).read_bytes())
        for _ in range(rng.randint(1, 8)):
            if content:
                content[rng.randrange(len(content))] = rng.randrange(256)
        return bytes(content)
    return rng.randbytes(rng.choice((4, 12, 40, 120, 400)))


def corpus(name: str) -> list[Path]:
    """Return the stored inputs for an entrance: each once triggered a bug, or nearly."""
    folder = CORPUS / name
    return sorted(path for path in folder.glob("*") if path.is_file()) if folder.is_dir() else []


def shrunk(data: bytes, fails: Callable[[bytes], bool], seconds: float = 20.0) -> bytes:
    """Return a shorter or plainer input that fails alike: pieces cut out, bytes set to zero."""
    end = time.perf_counter() + seconds
    size = max(len(data) // 2, 1)
    while size and time.perf_counter() < end:
        offset = 0
        while offset < len(data) and time.perf_counter() < end:
            shorter = data[:offset] + data[offset + size :]
            if fails(shorter):
                data = shorter
            else:
                offset += size
        size //= 2
    for offset in range(len(data)):
        plainer = data[:offset] + b"\0" + data[offset + 1 :]
        if data[offset] and time.perf_counter() < end and fails(plainer):
            data = plainer
    return data


def refuse_unless_sentence(error: Exception, *words: str) -> None:
    """Fail unless an error is a sentence, of a length that can be read, that has these words."""
    text = str(error)
    assert all(word in text for word in words), text
    assert text.strip(), "an error says nothing"
    assert text.rstrip().endswith((".", ")", "…")), f"no end of a sentence: {text[-80:]!r}"
    assert len(text) < 4000, f"an error of {len(text)} characters: {text[:200]!r}"


@cache
def scratch() -> Path:
    """Return this process's folder; it goes when the process ends."""
    parent = MEMORY if MEMORY.is_dir() else None
    folder = Path(tempfile.mkdtemp(prefix="gyrospark-fuzz-", dir=parent))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
