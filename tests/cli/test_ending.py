"""A signal ends the program wherever it comes."""

import signal
import sys

import pytest
from forked import ended

# the signal comes while an object is cleared away: what is raised there is dropped by Python
SCRIPT = """
import os, signal, sys, time, weakref
from hdbench_cli import main

# at once: the signal is sent again while the main thread still deals with the lost one
main._AGAIN_S = 0.0

# tests that run in the background are born deaf to Ctrl-C
signal.signal(signal.SIGINT, signal.default_int_handler)

class Thing: pass

main.end_by_signals()
thing = Thing()
hook = weakref.ref(thing, lambda _: os.kill(os.getpid(), int(sys.argv[1])))
del thing
time.sleep(float(sys.argv[2]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
@pytest.mark.parametrize(
    ("signum", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129), (signal.SIGINT, -2)]
)
def test_a_signal_that_comes_while_something_is_cleared_away_is_not_lost(signum, code):
    done = ended([sys.executable, "-c", SCRIPT, int(signum), 50])
    assert done.returncode == code
    assert "ignored" not in done.stderr


def test_what_else_python_cannot_raise_is_told_as_ever():
    script = SCRIPT.replace("os.kill(os.getpid(), int(sys.argv[1]))", "1 / 0")
    done = ended([sys.executable, "-c", script, 0, 0])
    assert "ZeroDivisionError" in done.stderr
