"""Options of the test run, and a SIGINT that tests can send."""

from __future__ import annotations

import signal

import pytest

# A shell that starts the run in the background has SIGINT ignored, and so would every process
# that a test starts and interrupts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update", action="store_true",
        help="rewrite generated/ from the generator instead of comparing with it",
    )
