"""Errors say what, where and one fix, as data too."""

import pickle

import pytest

from hdbench import errors


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        (errors.UsageError, 2),
        (errors.LimitError, 3),
        (errors.DataError, 4),
        (errors.ProfileError, 4),
        (errors.DeviceError, 5),
        (errors.DoubtfulDataError, 6),
        (errors.StorageError, 7),
        (errors.UnsafeError, 8),
        (errors.BusyError, 9),
    ],
)
def test_every_kind_has_the_contract_s_exit_code_and_crosses_processes(kind, code) -> None:
    error = kind("found 3 V, needed 2 V", where="channel 1", fix="turn it down")
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is kind
    assert again.exit_code == code
    assert again.to_dict() == error.to_dict()
    assert str(again) == "channel 1: found 3 V, needed 2 V\n  fix: turn it down"


def test_a_stop_keeps_its_signal_s_exit_code_across_processes() -> None:
    stopped = errors.Stopped("stopped", where="run", fix="look", exit_code=143)
    assert pickle.loads(pickle.dumps(stopped)).exit_code == 143
