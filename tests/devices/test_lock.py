"""One process per bench, whatever the bench is called; a stop signals that process alone."""

import os
import signal
import socket
import stat
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from dataclasses import replace

import pytest
from nodekit import until

from hdbench.devices import lock, open_bench
from hdbench.devices.lock import exclusive, release
from hdbench.errors import BusyError, StorageError
from hdbench.profile import load_profile
from hdbench.system import files, processes
from hdbench.system.processes import process_mark

LINE = "rtu:///dev/no-such-line"
HOLD = """
import fcntl, os, sys, time
handle = os.open(sys.argv[1], os.O_RDWR | os.O_CREAT, 0o600)
fcntl.flock(handle, fcntl.LOCK_EX)
os.write(handle, sys.argv[2].encode())
print("held", flush=True)
time.sleep(60)
"""
RUN = """
import sys, time
from hdbench.devices.lock import exclusive
with exclusive(sys.argv[1]):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    tmp_path.chmod(0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))


def holder(address):
    """Return the number of the process that has locked the file, as the file tells it."""
    path = lock._held(address)
    found = lock.Holder() if path is None else lock._holder_in(path)
    return found.pid if found.pid and found.mark == (process_mark(found.pid) or "-") else None


@contextmanager
def process(program, *words, held=True):
    command = [sys.executable, "-c", program, *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        try:
            assert not held or running.stdout.readline() == "held\n"
            yield running
        finally:
            running.kill()


def not_released(text):
    """Ask for the end of a process that holds the file with this text; nobody may be signalled."""
    with process(HOLD, str(lock._path(LINE)), text + "\n") as other:
        with pytest.raises(BusyError) as caught:
            release(LINE, timeout_s=0.3)
        assert caught.value.fix
        assert other.poll() is None


WORD = 32 * "0"


@pytest.mark.parametrize(
    "told",
    [
        "{pid}", f"{{pid}} boot:1 1 {WORD}", f"{{pid}} - 1 {WORD}",
        f"{{pid}} {{mark}} 1 {WORD[1:]}", f"1 - 0 {WORD}", "", "x y",
    ],
)  # fmt: skip
def test_a_stop_never_signals_a_process_that_does_not_hold_the_bench(told):
    with process("import time; print('held', flush=True); time.sleep(60)") as stranger:
        not_released(told.format(pid=stranger.pid, mark=process_mark(stranger.pid)))
        assert stranger.poll() is None, "a stranger was ended"
        assert holder(LINE) is None


def test_a_run_that_has_yet_to_write_who_it_is_is_ended_too():
    slow = """
import os, time
write = os.write
os.write = lambda *told: (time.sleep(0.5), write(*told))[1]
"""
    with process(slow + RUN, LINE, held=False) as run:
        until(lock._path(LINE).exists, 20.0)
        # between opening and locking it
        time.sleep(0.1)
        release(LINE)
        assert run.wait(60) == -signal.SIGTERM


def test_a_process_that_died_holds_nothing_and_its_number_is_signalled_no_more():
    with process(RUN, LINE) as run:
        run.kill()
        run.wait(60)
        assert holder(LINE) is None
        release(LINE)
        with exclusive(LINE):
            assert holder(LINE) == os.getpid()


def listens(number):
    """Return a mark that skips a test where this is no address of this computer."""
    try:
        socket.create_server(
            (number, 0), family=socket.AF_INET6 if ":" in number else socket.AF_INET
        ).close()
    except OSError:
        return pytest.mark.skip(reason=f"{number} is no address of this computer")
    return ()


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("tcp://192.0.2.7", "tcp://192.0.2.7:502"),
        ("tcp://[fd00::7]:502", "tls://[fd00::7]:502"),
        pytest.param("tcp://127.0.0.1:502", "tcp://[::1]:502", marks=listens("::1")),
        pytest.param("tcp://127.0.0.1:502", "udp://127.0.0.2:502", marks=listens("127.0.0.2")),
        ("rtu://{folder}/by-id/usb-1", "rtu://{folder}/ttyUSB0"),
        ("rtu://{folder}/by-id/usb-1?baud=9600", "serial://{folder}/ttyUSB0"),
    ],
)
def test_one_bench_by_two_names_is_one_bench(one, other, tmp_path):
    (tmp_path / "ttyUSB0").touch()
    (tmp_path / "by-id").mkdir()
    (tmp_path / "by-id" / "usb-1").symlink_to("../ttyUSB0")
    one, other = (text.format(folder=tmp_path) for text in (one, other))
    with exclusive(one):
        assert holder(other) == os.getpid()
        with pytest.raises(BusyError, match=str(os.getpid())), exclusive(other):
            pass
    with exclusive(other):
        pass


def test_localhost_is_the_bench_at_its_number():
    with (
        exclusive("tcp://127.0.0.1:9"),
        pytest.raises(BusyError),
        open_bench(load_profile("cim-tr-97-06"), address="tcp://localhost:9"),
    ):
        pass


def test_two_benches_are_two():
    with exclusive("tcp://192.0.2.7:502"), exclusive("tcp://192.0.2.7:503"), exclusive(LINE):
        pass


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no abstract names")
def test_a_bench_that_another_user_runs_is_busy():
    with socket.socket(socket.AF_UNIX) as theirs:
        theirs.bind("\0hdbench:192.0.2.7:502")
        with pytest.raises(BusyError, match="another user"), exclusive("tcp://192.0.2.7:502"):
            pass


def test_the_lock_is_in_a_folder_that_nobody_else_can_enter(tmp_path):
    with exclusive(LINE):
        assert lock._path(LINE).is_relative_to(tmp_path)
        assert stat.S_IMODE(lock._path(LINE).stat().st_mode) == 0o600
        assert stat.S_IMODE(lock._path(LINE).parent.stat().st_mode) == 0o700


@pytest.mark.parametrize("kind", ["open to all", "link"])
def test_a_folder_that_others_can_enter_is_not_used(kind, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "gone"))
    monkeypatch.setattr(files, "_SYSTEM", str(tmp_path / "gone"))
    folder = tmp_path / f"hdbench-{os.getuid()}"
    if kind == "link":
        (tmp_path / "theirs").mkdir(mode=0o700)
        folder.symlink_to("theirs")
    else:
        folder.mkdir()
        folder.chmod(0o777)
    with pytest.raises(StorageError, match=folder.name) as caught, exclusive(LINE):
        pass
    assert caught.value.fix
    # a person who wants to stop a bench is not kept from it
    assert holder(LINE) is None
    release(LINE)


def test_a_lock_that_cannot_be_written_is_told(monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(StorageError, match="No space left"), exclusive(LINE):
        pass


@pytest.mark.parametrize("told", ["{pid} boot:1 {port} " + WORD, "{pid} - {port} " + WORD])
def test_a_request_that_nobody_understands_stops_nobody(told):
    """A port that another program has by now."""
    with socket.create_server(("127.0.0.1", 0)) as stranger:
        not_released(told.format(pid=os.getpid() + 1, port=stranger.getsockname()[1]))


def test_where_no_signal_is_safe_the_run_is_asked_to_end(monkeypatch):
    monkeypatch.setattr(lock, "terminate", lambda pid, mark: False)
    with process(RUN, LINE) as run:
        release(LINE)
        assert run.wait(60) == -signal.SIGTERM
    assert holder(LINE) is None


def test_only_who_knows_the_word_can_ask(monkeypatch):
    monkeypatch.setattr(processes, "signal_self", lambda _: pytest.fail("asked to end"))
    with exclusive(LINE):
        found = lock._holder_in(lock._path(LINE))
        assert found.ask("here")
        assert not replace(found, secret=WORD).ask("stop")


def test_without_locks_a_bench_is_held_while_its_process_answers(monkeypatch):
    monkeypatch.setattr(lock, "lock_file", lambda _: None)
    with process(RUN, LINE) as run:
        with pytest.raises(BusyError, match=str(run.pid)), exclusive(LINE):
            pass
        run.kill()
        run.wait(60)
    with exclusive(LINE):
        pass


def test_callers_who_say_nothing_keep_no_request_from_being_heard():
    with lock.listening() as place:
        port, secret = place.split()
        with ExitStack() as silent:
            for _ in range(3):
                silent.enter_context(socket.create_connection(("127.0.0.1", int(port))))
            assert lock.Holder(port=int(port), secret=secret).ask("here")
