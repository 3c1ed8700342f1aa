"""Results are JSON without NaN, written whole or not at all."""

import errno
import itertools
import json
import os
import signal
import subprocess
import time

import numpy as np
import pytest
from forked import forked

from hdbench.errors import DataError, StorageError
from hdbench.profile import load_profile
from hdbench.records import read_json, result_header, write_json
from hdbench.records.jsonfile import dumps


@pytest.mark.parametrize("value", [float("nan"), float("inf"), np.nan, np.array([1.0, -np.inf])])
def test_a_number_that_json_lacks_is_a_bug_not_a_file(tmp_path, value):
    with pytest.raises(ValueError, match="JSON compliant"):
        write_json(tmp_path / "r.json", {"a": [value]})
    assert list(tmp_path.iterdir()) == []


def test_numpy_values_keep_their_full_precision(tmp_path):
    body = {"f": np.float64(0.1) * 3, "i": np.int64(7), "a": np.arange(3.0), "b": np.bool_(True)}
    write_json(tmp_path / "r.json", body)
    expected = {"f": 0.30000000000000004, "i": 7, "a": [0.0, 1.0, 2.0], "b": True}
    assert json.loads((tmp_path / "r.json").read_text()) == expected


def test_the_header_is_that_of_the_contract():
    profile = load_profile("cim-tr-97-06")
    head = result_header("ripple", profile)
    assert head["schema"] == "hdbench/ripple/1"
    assert head["profile"] == {"name": profile.name, "sha256": profile.sha256}
    assert isinstance(head["hdbench_version"], str)
    assert result_header("ripple", None)["profile"] is None


@pytest.mark.parametrize(
    ("text", "word"),
    [
        *(('{"a": NaN}', "NaN"), ('{"a": 1e999}', "1e999"), ('{"a": 1, "a": 2}', "twice")),
        *(("[" * 100_000, "deep"), ("[1]", "list"), ("1" * 5000, "JSON")),
        *(('{"a": 1', "not valid JSON"), ("", "not valid JSON")),
        ('{"schema": "hdbench/other/1"}', "hdbench/ripple/1"),
    ],
)
def test_a_file_that_is_no_result_is_refused(tmp_path, text, word):
    path = tmp_path / "r.json"
    path.write_text(text)
    with pytest.raises(DataError) as caught:
        read_json(path, "hdbench/ripple/1")
    assert word in caught.value.what
    assert caught.value.where.startswith(str(path))


@pytest.mark.parametrize("call", ["fsync", "open"])
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO])
def test_a_full_or_failing_disk_leaves_the_old_file(tmp_path, monkeypatch, call, code):
    path = tmp_path / "r.json"
    write_json(path, {"old": 1})

    def fail(*_args, **_keys):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr({"fsync": os, "open": type(path)}[call], call, fail)
    with pytest.raises(StorageError):
        write_json(path, {"new": 2})
    monkeypatch.undo()
    assert json.loads(path.read_text()) == {"old": 1}
    assert [entry.name for entry in tmp_path.iterdir()] == ["r.json"]


def test_a_missing_folder_is_a_storage_error(tmp_path):
    with pytest.raises(StorageError) as failed:
        write_json(tmp_path / "no" / "r.json", {})
    assert "make that folder" in str(failed.value.fix)


def write_for_ever(path):
    for k in itertools.count():
        write_json(path, {"k": k, "fill": [k] * 20000})
        if k == 1:
            os.write(1, b"ready\n")


@pytest.mark.skipif(os.name != "posix", reason="kill -9")
def test_a_killed_writer_leaves_the_old_or_the_new_file(tmp_path):
    path = tmp_path / "r.json"
    for wait_s in (0.0, 0.003, 0.011):
        with forked(lambda: write_for_ever(path), stdout=subprocess.PIPE) as process:
            process.stdout.readline()
            time.sleep(wait_s)
            process.send_signal(signal.SIGKILL)
        body = json.loads(path.read_text())
        assert body["fill"] == [body["k"]] * 20000


def test_text_ends_with_a_newline_and_reads_back():
    assert json.loads(dumps({"µ": "\ud800"})) == {"µ": "\ud800"}
    assert dumps({}).endswith("\n")
