"""hdbench where POSIX is missing: the experiments, a person, a stop, all over TCP."""

import pytest
from portability import ForeignSystem, program

SEEN = """
import os, socket
from hdbench.devices import lock
from hdbench.system import files, keyboard, lines, processes, sockets

near, far = socket.socketpair()
handle = os.open(os.devnull, os.O_RDWR)
print(
    type(keyboard.keyboard(0)).__name__,
    sockets.TimedSocket(near)._poll,
    files.lock_file(handle),
    processes.terminate(os.getpid(), processes.process_mark(os.getpid())),
    lines.can_share_ports(),
)
lines.terminal_pair()
"""


@pytest.fixture
def foreign(tmp_path):
    return ForeignSystem(tmp_path)


def test_posix_is_hidden(foreign):
    """Else what follows would show nothing."""
    foreign._start[2] = program(hidden=True).partition("import json")[0] + SEEN
    done = foreign.run()
    assert done.stdout == "Keyboard None None False False\n", done.stderr
    assert "UsageError" in done.stderr
    assert "no pseudo-terminals" in done.stderr


def test_ripple_misalignment_and_monitor(foreign):
    foreign.experiments()


def test_a_person_calibrates_leaves_and_resumes(foreign):
    foreign.calibration()


def test_a_bench_that_another_process_drives_is_stopped(foreign):
    foreign.stop()
