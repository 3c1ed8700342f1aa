"""Memory that arrays leave is used again."""

import ctypes
import platform

import numpy as np
import pytest

from hdbench.system.memory import memory_kept

_SIZE = 8_000_000  # 64 MB, more than the C library keeps by itself


def _new_pages() -> int:
    """Return how many pages the system makes for an array that is written."""
    import resource

    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    np.empty(_SIZE).fill(1.0)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc keeps memory")
def test_a_second_array_takes_the_memory_of_the_first() -> None:
    with memory_kept():
        first, second = _new_pages(), _new_pages()
    assert second < first / 4
    assert _new_pages() > 4 * second


def test_a_system_without_the_calls_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: object) -> None:
        raise OSError("no library")

    monkeypatch.setattr(ctypes, "CDLL", refuse)
    with memory_kept():
        assert _SIZE > 0
