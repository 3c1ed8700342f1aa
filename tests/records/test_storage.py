"""Writing replaces regular files only: links keep their target, devices and pipes stay."""

import os
import shutil
import stat
import threading

import pytest

from hdbench.errors import StorageError
from hdbench.records import storage

POSIX = pytest.mark.skipif(os.name != "posix", reason="pipes and links of a POSIX system")


@POSIX
def test_a_link_stays_a_link_and_its_target_is_written(tmp_path):
    target, link = tmp_path / "kept.csv", tmp_path / "link.csv"
    target.write_bytes(b"old")
    link.symlink_to(target)
    storage.write_atomic(link, b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"


@POSIX
def test_a_pipe_is_written_into_and_not_replaced(tmp_path):
    pipe, staged, got = tmp_path / "pipe", tmp_path / ".staged", []
    os.mkfifo(pipe)
    for write in (
        lambda: storage.write_atomic(pipe, [b"a", b"b"]),
        lambda: storage.publish(staged, pipe),
    ):
        staged.write_bytes(b"ab")
        reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()), daemon=True)
        reader.start()
        write()
        reader.join(timeout=60)
        assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert got == [b"ab", b"ab"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full on this system")
def test_a_full_device_is_a_storage_fault(tmp_path):
    # through a link of our own, so that a failure of this test cannot replace the device
    link = tmp_path / "full.csv"
    link.symlink_to("/dev/full")
    with pytest.raises(StorageError):
        storage.write_atomic(link, b"x" * 100_000)
    assert link.is_symlink()


def test_the_reserve_takes_room_and_gives_it_back(tmp_path):
    storage.keep_reserve(tmp_path)
    taken = (tmp_path / storage.RESERVE_NAME).stat()
    assert taken.st_blocks * 512 >= 4 << 20
    storage.free_reserve(tmp_path)
    storage.free_reserve(tmp_path)
    assert not (tmp_path / storage.RESERVE_NAME).exists()


def test_a_run_that_does_not_fit_twice_is_refused_before_it_begins(tmp_path):
    free = shutil.disk_usage(tmp_path).free
    storage.check_space(tmp_path, 1000)
    with pytest.raises(StorageError, match="twice what the run takes"):
        storage.check_space(tmp_path, free)
