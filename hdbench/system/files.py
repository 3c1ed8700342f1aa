"""Files: locks, syncs, room on the disk, and folders of one user."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import Any

OPEN_OWN = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
"""Flags of `os.open` for a file that is no link and that no child inherits."""

# folders of the system, one per user
_SYSTEM = "/run/user"
# Windows keeps others from reading what is locked, so one byte far behind the content is; its
# offsets have 31 bits
_LOCK_AT = (1 << 31) - 2
_OWNED = hasattr(os, "geteuid")


def packaged_toml(package: str, name: str) -> dict[str, Any]:
    """Return what a TOML file of a package declares."""
    # the guard needs neither, and starts with this module
    import tomllib
    from importlib import resources

    return tomllib.loads((resources.files(package) / name).read_text(encoding="utf-8"))


def lock_file(descriptor: int) -> bool | None:
    """Lock an open file until it is closed or this process ends."""
    try:
        import fcntl
    except ImportError:
        return _lock_byte(descriptor)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def _lock_byte(descriptor: int) -> bool | None:
    try:
        import msvcrt
    except ImportError:
        return None
    at = os.lseek(descriptor, 0, os.SEEK_CUR)
    try:
        os.lseek(descriptor, _LOCK_AT, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    except OSError as error:
        return False if error.errno in (errno.EACCES, errno.EDEADLK) else None
    finally:
        os.lseek(descriptor, at, os.SEEK_SET)
    return True


def sync_file(descriptor: int) -> None:
    """Return once the disk has the file."""
    try:
        from fcntl import F_FULLFSYNC, fcntl
    except ImportError:
        os.fsync(descriptor)
        return
    # on macOS `fsync` leaves it in the cache of the disk; some file systems know nothing better
    try:
        fcntl(descriptor, F_FULLFSYNC)
    except OSError as error:
        if error.errno not in (errno.ENOTSUP, errno.EINVAL, errno.ENOTTY):
            raise
        os.fsync(descriptor)


def sync_data(descriptor: int) -> None:
    """Return once the disk has the content of the file, its times perhaps not."""
    if hasattr(os, "fdatasync"):
        os.fdatasync(descriptor)
    else:
        sync_file(descriptor)


def sync_folder(folder: Path) -> None:
    """Make the names in `folder` survive a power cut; Windows has no call for that."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def allocate(descriptor: int, size: int) -> None:
    """Take room on the disk for an empty file; where the file system cannot, write zeros."""
    try:
        os.posix_fallocate(descriptor, 0, size)
    except (AttributeError, OSError) as error:
        known = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS)
        if isinstance(error, OSError) and error.errno not in known:
            raise
        block = bytes(1 << 16)
        for _ in range(size // len(block)):
            os.write(descriptor, block)


def is_private(mode: int) -> bool:
    """Return whether a file's mode keeps all but its owner out; True where modes say nothing."""
    return os.name != "posix" or not stat.S_IMODE(mode) & 0o077


def user_folders() -> list[Path]:
    """Return where files for other processes of this user may be, the place for new ones first."""
    if not _OWNED:
        import tempfile

        return [Path(os.environ.get("LOCALAPPDATA") or tempfile.gettempdir()) / "hdbench"]
    places = [os.environ.get("XDG_RUNTIME_DIR", ""), f"{_SYSTEM}/{os.geteuid()}"]
    found = [Path(place) / "hdbench" for place in places if place and is_own(Path(place))]
    return [*found, Path(os.environ.get("TMPDIR") or "/tmp") / f"hdbench-{os.geteuid()}"]


def is_own(folder: Path) -> bool:
    """Return whether it is a folder, no link, that only this user can enter.

    On Windows a folder in the user's own folder is.
    """
    try:
        found = folder.lstat()
    except OSError:
        return False
    own = not _OWNED or (found.st_uid == os.geteuid() and not stat.S_IMODE(found.st_mode) & 0o077)
    return stat.S_ISDIR(found.st_mode) and own
