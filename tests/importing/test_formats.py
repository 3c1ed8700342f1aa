"""Logs of every format become the same trace; damaged ones are refused in one line.

Formats whose library is not installed are skipped: `make formats`, a part of `make test`, installs
them all.
"""

import os
import random
import shlex
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from forked import ended
from import_fuzz import GOOD, MOST_MIB, run
from import_samples import MAPS, SAMPLES, have, signals, write_sample
from publicdata import DATA, needs_data

from hdbench.errors import DataError, HdbenchError, UsageError
from hdbench.importing import registry
from hdbench.importing.importer import import_files
from hdbench.importing.recipe import Recipe, read_recipe, write_recipe
from hdbench.importing.registry import IsolatedSource, end_reader, open_source
from hdbench.records import input_identity, read_trace

REAL = DATA / "real"
JOINTS = ("db3", "mcap", "ros1")


def forms(*chosen: str) -> list[object]:
    return [
        pytest.param(form, marks=pytest.mark.skipif(not have(*SAMPLES[form][1]), reason="library"))
        for form in chosen or SAMPLES
    ]


def recipe(form: str, **more: object) -> Recipe:
    maps = dict(text.split("=", 1) for text in MAPS[form])
    return Recipe(map=maps, joint="elbow" if form in JOINTS else None, **more)


@pytest.mark.parametrize("form", forms())
def test_every_format_gives_the_same_trace(form, tmp_path):
    file, out = write_sample(form, tmp_path), tmp_path / "out.csv"
    report = import_files(recipe(form), [file], out)
    trace, kept = read_trace(out), signals()
    assert report.rows == 200
    # times of a bag are whole ns; text has twelve digits
    np.testing.assert_allclose(trace.time_s, kept["time"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(trace["torque_nm"], kept["torque"], rtol=1e-11)
    np.testing.assert_allclose(
        trace["motor_velocity_rad_s"], kept["speed"] * np.pi / 30.0, rtol=1e-11
    )


@pytest.mark.parametrize("form", forms())
def test_a_file_that_was_cut_is_refused_and_nothing_is_left(form, tmp_path):
    chance = random.Random(7)
    file, out = write_sample(form, tmp_path), tmp_path / "out.csv"
    raw = file.read_bytes()
    for _ in range(20):
        cut = chance.randrange(len(raw) - 1)
        file.write_bytes(raw[:cut])
        try:
            import_files(recipe(form), [file], out)
        except HdbenchError as error:
            code, told = error.exit_code, error.what
        else:
            # a cut text may end with a whole row, or a number of fewer digits: nothing tells
            assert form == "text"
            out.unlink()
            out.with_name("out.csv.provenance.json").unlink()
            continue
        assert code in (2, 4)
        assert "\n" not in told
        assert sorted(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("form", forms("text", "json", "npz", "mat5", "mat73", "mdf"))
def test_mutated_files_are_imported_or_refused(form, tmp_path):
    # the whole campaign is tools/import_fuzz.py
    ends, memory, _ = run(form, 20, 3, tmp_path)
    assert set(ends) <= set(GOOD)
    assert memory < MOST_MIB


@pytest.mark.parametrize("form", forms())
@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lambda kept: {**kept, "torque": kept["torque"] * np.nan}, "holds no number"),
        (lambda kept: {**kept, "time": kept["time"][::-1]}, "goes back|strictly increasing"),
        (lambda kept: {name: values[:0] for name, values in kept.items()}, "no data|no .* number"),
        (lambda kept: {name: values[:1] for name, values in kept.items()}, "1 row|no .* number"),
    ],
    ids=["only-nan", "backwards", "no-row", "one-row"],
)
def test_channels_that_cannot_be_used_are_refused_in_every_format(form, spoil, word, tmp_path):
    if form in ("tdms", *JOINTS) and "back" in word:
        pytest.skip("a waveform has no times, and messages come in the order of theirs")
    kept = spoil(signals())
    if form == "json" and not len(kept["time"]):
        pytest.skip("an object without records is a record itself")
    file = write_sample(form, tmp_path, kept)
    with pytest.raises(DataError, match=word) as caught:
        import_files(recipe(form), [file], tmp_path / "out.csv")
    assert "\n" not in str(caught.value.what)
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("form", forms("mat5", "hdf5", "parquet", "tdms", "mdf", "db3"))
def test_compiled_libraries_read_where_their_crash_is_an_error(form, tmp_path):
    source = open_source(write_sample(form, tmp_path))
    assert isinstance(source, IsolatedSource)
    source.close()


def library(monkeypatch: pytest.MonkeyPatch, folder: Path, code: str) -> Path:
    """Make a library that can be imported, and a file to read with it."""
    (folder / "a_library.py").write_text(code)
    monkeypatch.syspath_prepend(folder)
    end_reader()  # the next one sees that folder
    return write_sample("npz", folder)


@pytest.mark.parametrize(
    ("code", "word"),
    [
        ("import ctypes; ctypes.string_at(0)", "its reader crashed"),
        ("import os; os._exit(3)", "its reader crashed"),
        pytest.param(
            "bytearray(1 << 30)",
            "more memory than there is",
            marks=pytest.mark.skipif(sys.platform != "linux", reason="no limit of memory here"),
        ),
    ],
)
def test_a_library_that_ends_its_process_is_an_error_of_the_file(code, word, tmp_path, monkeypatch):
    file = library(monkeypatch, tmp_path, code)
    with pytest.raises(DataError, match=word):
        IsolatedSource(file, "NumPy file", "npz", "a_library", "none")
    # the next file is read by a new process
    source = IsolatedSource(file, "NumPy file", "npz", "numpy", "none")
    assert [channel.name for channel in source.channels] == ["time", "speed", "torque"]
    source.close()


@pytest.mark.parametrize("path", [None, "", "/none"], ids=["memory", "no memory", "not reached"])
def test_files_that_are_read_in_turns_keep_their_own_numbers(path, tmp_path, monkeypatch):
    if path is not None:  # as on systems without memory for two processes
        monkeypatch.setattr(registry, "shared_memory", lambda _: nullcontext((b"", path)))
    rows, columns = 100_000, 20  # more than the memory for two processes takes of one piece
    tables = [np.random.default_rng(seed).normal(size=(rows, columns)) for seed in (1, 2)]
    sources = []
    for k, table in enumerate(tables):
        np.save(tmp_path / f"{k}.npy", table)
        sources.append(IsolatedSource(tmp_path / f"{k}.npy", "NumPy file", "npz", "numpy", "none"))
    names = [[channel.name for channel in source.channels] for source in sources]
    turns = zip(*(s.pieces(n) for s, n in zip(sources, names, strict=True)), strict=True)
    row = 0
    for pieces in turns:
        count = len(pieces[0][names[0][0]])
        for piece, table in zip(pieces, tables, strict=True):
            np.testing.assert_array_equal(np.transpose([*piece.values()]), table[row : row + count])
        row += count
    assert row == rows
    for source in sources:
        source.close()


_ALONE = """
import os, sys
from pathlib import Path
from hdbench.importing.registry import end_reader, IsolatedSource
import hdbench.importing.registry as registry
for library in ("a_library", "numpy"):
    try:
        source = IsolatedSource(Path(sys.argv[1]), "NumPy file", "npz", library, "none")
        print(type(registry._running._process).__name__, *[c.name for c in source.channels])
        (piece,) = source.pieces(["speed", "torque"])
        print(len(piece["speed"]), round(float(piece["torque"].max()), 3))
    except Exception as error:
        print(error.what)
end_reader()
try:
    os.wait()
except ChildProcessError:
    print("no child is left")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="a fork is safe on Linux only")
def test_a_process_of_one_thread_reads_by_a_fork_under_the_same_limits(tmp_path, monkeypatch):
    file = library(monkeypatch, tmp_path, "bytearray(1 << 30)")
    paths = os.pathsep.join(path for path in sys.path if path)
    ran = ended([sys.executable, "-c", _ALONE, file], env={**os.environ, "PYTHONPATH": paths})
    assert ran.returncode == 0, ran.stderr
    refused, *read = ran.stdout.splitlines()
    assert "more memory than there is" in refused
    assert read == ["Fork time speed torque", "200 1.3", "no child is left"]


def test_what_a_file_makes_its_library_do_stays_in_the_file(tmp_path, monkeypatch):
    code = (
        "import pickle, numpy.lib.format as f\n"
        "f.read_magic = lambda file: pickle.loads(b'cos\\nsystem\\n.')"
    )
    file = library(monkeypatch, tmp_path, code)
    with pytest.raises(DataError, match="only holds data"):
        IsolatedSource(file, "NumPy file", "npz", "a_library", "none")
    end_reader()


def test_a_formula_in_a_file_is_never_run(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    time = np.arange(5.0)
    plain = asammdf.Signal(time, time, name="torque", unit="Nm")
    formula = asammdf.Signal(time, time, name="speed", conversion={"formula": "X1 * 2"})
    with asammdf.MDF(version="4.10") as file:
        file.append([plain, formula])
        file.save(tmp_path / "log.mf4")
    source = open_source(tmp_path / "log.mf4", recipe("mdf"))
    assert [channel.name for channel in source.channels] == ["group1/time", "group1/torque"]
    assert "not run" in source.notes[0]
    source.close()


@pytest.mark.parametrize(
    "ending", [".npz", ".mat", ".h5", ".parquet", ".xlsx", ".tdms", ".mf4", ".db3"]
)
def test_ten_gigabytes_of_nothing_and_a_wrong_beginning(ending, tmp_path):
    sparse = tmp_path / f"x.{ending}"
    with sparse.open("wb") as file:
        file.truncate(10 << 30)
    wrong = tmp_path / f"y.{ending}"
    wrong.write_bytes(b"RIFF\0\0\0\0 of another kind")
    for path in (sparse, wrong):
        with pytest.raises(DataError, match="begins with"):
            import_files(recipe("npz"), [path], tmp_path / "out.csv")


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("time,torque,torque,speed\n0,1,2,3\n1,1,2,3\n", "means 2 channels"),
        ("time,tor\x07que,speed\n0,1,2\n1,1,2\n", "control character"),
    ],
)
def test_names_that_cannot_be_used_are_refused(text, word, tmp_path):
    file = tmp_path / "log.csv"
    file.write_text(text)
    name = "tor\x07que" if "\x07" in text else "torque"
    asked = Recipe(map={"time_s": "time", "torque_nm": name, "motor_velocity_rad_s": "speed"})
    with pytest.raises(DataError, match=word):
        import_files(asked, [file], tmp_path / "out.csv")
    assert list(tmp_path.iterdir()) == [file]


def test_a_column_of_remarks_without_a_remark_keeps_the_names(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("time,torque,speed,remarks\n" + "".join(f"{k},1,2,\n" for k in range(9)))
    source = open_source(file, recipe("text"))
    assert [channel.name for channel in source.channels] == ["time", "torque", "speed", "remarks"]


def test_a_pickle_in_a_numpy_file_is_never_opened(tmp_path):
    file = tmp_path / "log.npz"
    np.savez(file, time=np.arange(3.0), torque=np.array([object()] * 3))
    with pytest.raises(DataError, match="never unpickled"):
        import_files(recipe("npz"), [file], tmp_path / "out.csv")


def made(tmp_path: Path, columns: dict[str, Sequence[float]], asked: Recipe, ratio: float = 50.0):
    file, out = tmp_path / "log.npz", tmp_path / "out.csv"
    np.savez(file, **{name: np.asarray(values) for name, values in columns.items()})
    report = import_files(asked, [file], out, gear_ratio=ratio)
    return read_trace(out, require=("torque",)), report


def test_declared_conversions_do_what_they_say(tmp_path):
    turn = np.arange(40) * 100.0
    columns = {
        "t": np.arange(40.0),
        "angle": turn % 360.0,
        "load": np.array([3, 65535] * 20),
        "joint": 0.1 + 0.01 * np.arange(40),
    }
    asked = {
        "time_s": "t@ms",
        "motor_angle_rad": "angle@deg@wrapped",
        "torque_nm": "load*0.5@int16",
        "output_angle_rad": "joint",
    }
    trace, report = made(tmp_path, columns, Recipe(map=asked))
    np.testing.assert_allclose(trace.time_s, np.arange(40) / 1000.0, rtol=1e-15)
    # 40 sums of doubles of 70 rad at most: some 1e-14 each
    np.testing.assert_allclose(trace["motor_angle_rad"], np.radians(turn), rtol=0, atol=1e-11)
    assert trace["torque_nm"][:2].tolist() == [1.5, -0.5]
    assert any("two's complement" in step for step in report.done["torque_nm"])
    asked = {"time_s": "t", "motor_angle_rad": "joint", "torque_nm": "load"}
    trace, report = made(tmp_path, columns, Recipe(map=asked, side="output"))
    np.testing.assert_allclose(trace["motor_angle_rad"], 0.5 * np.arange(40), atol=1e-12)
    assert any("gear ratio 50" in step for step in report.done["motor_angle_rad"])


def test_torque_from_current_and_velocity_from_angle(tmp_path):
    time = np.arange(2000) / 1000.0
    angle = 30.0 * time + 0.2 * np.sin(2.0 * np.pi * 4.0 * time)
    columns = {"t": time, "q": angle, "i": np.cos(time)}
    asked = {"time_s": "t", "motor_angle_rad": "q", "motor_current_a": "i"}
    mapped = Recipe(map=asked, torque_constant_nm_per_a=2.5, velocity_from_angle_hz=60.0)
    trace, report = made(tmp_path, columns, mapped)
    assert trace["torque_nm"].tolist() == (2.5 * np.cos(time)).tolist()
    true = 30.0 + 0.2 * 8.0 * np.pi * np.cos(2.0 * np.pi * 4.0 * time)
    inside = slice(100, -100)
    # central differences lose (2 pi 4 / 1000)^2 / 6 of the 5 rad/s, the low-pass 3e-10 of it
    error = trace["motor_velocity_rad_s"][inside] - true[inside]
    assert np.max(np.abs(error)) < 1e-3
    assert any("zero phase" in step for step in report.done["motor_velocity_rad_s"])


def test_channels_of_two_clocks_are_put_on_one(tmp_path):
    fast, slow = np.arange(1000) / 1000.0, 0.1 + np.arange(80) / 100.0
    file = tmp_path / "log.h5"
    h5py = pytest.importorskip("h5py")
    with h5py.File(file, "w") as book:
        book["a/time"], book["a/torque"] = fast, np.cos(fast)
        book["b/time"], book["b/speed"] = slow, 5.0 + slow
    asked = Recipe(map={"torque_nm": "torque", "motor_velocity_rad_s": "speed"})
    report = import_files(asked, [file], tmp_path / "out.csv")
    trace = read_trace(tmp_path / "out.csv")
    # a line is interpolated without error; the overlap is 0.1 to 0.89 s
    assert len(trace) == 791
    np.testing.assert_allclose(trace["motor_velocity_rad_s"], 5.1 + trace.time_s, rtol=1e-12)
    assert any("linear interpolation" in note for note in report.notes)


def test_provenance_is_bound_to_the_content(tmp_path):
    file, out = write_sample("npz", tmp_path), tmp_path / "out.csv"
    import_files(recipe("npz"), [file], out)
    imported = input_identity(out)["imported"]
    assert imported["sources"][0]["form"] == "NumPy file"
    steps = ["channel 'torque'", "taken as N m: the file states no unit"]
    assert imported["columns"]["torque_nm"] == steps
    out.write_text(out.read_text() + "9,1,1\n")
    assert "imported" not in input_identity(out)


def test_a_recipe_is_kept_and_a_slip_in_it_is_told(tmp_path, answer):
    file, kept = write_sample("npz", tmp_path), tmp_path / "r.toml"
    write_recipe(kept, recipe("npz", side="output", rate_hz=None))
    assert read_recipe(kept) == recipe("npz", side="output")
    folder = tmp_path / "traces"
    folder.mkdir()
    answer("import", file, "--recipe", kept, "--out", folder, "--profile", "cim-tr-97-06")
    assert (folder / "sample.csv").is_file()
    kept.write_text('sides = "output"\n')
    with pytest.raises(DataError, match="did you mean 'side'") as caught:
        read_recipe(kept)
    assert caught.value.where.endswith("sides")


@pytest.fixture
def listing(answer):
    return partial(answer, "import", "--no-input")


def test_the_proposed_command_can_be_taken(tmp_path, listing, hdbench, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = write_sample("text", tmp_path)
    proposal = listing(file)["proposal"]
    assert proposal["map"] == {
        "time_s": "time", "torque_nm": "torque", "motor_velocity_rad_s": "speed@rpm",
    }  # fmt: skip
    hdbench(*shlex.split(proposal["command"])[1:])
    assert len(read_trace(tmp_path / "sample.trace.csv")) == 200


def test_a_proposal_does_not_cut_a_name_within_its_unit(tmp_path, listing):
    file = tmp_path / "log.csv"
    rows = "".join(f"{k},1500,{k % 3}\n" for k in range(9))
    file.write_text("Zeit [ms],Drehzahl [1/min],Drehmoment [Nm]\n" + rows)
    assert listing(file)["proposal"]["map"]["motor_velocity_rad_s"] == "Drehzahl [1/min]@1/min"


def test_the_joint_side_needs_a_gear_ratio(tmp_path, listing):
    columns = {"t": np.arange(3.0), "q": np.arange(3.0), "T": np.ones(3)}
    np.savez(tmp_path / "log.npz", **columns)
    asked = Recipe(map={"time_s": "t", "motor_angle_rad": "q", "torque_nm": "T"}, side="output")
    with pytest.raises(UsageError, match="gear ratio"):
        import_files(asked, [tmp_path / "log.npz"], tmp_path / "out.csv")
    # that of the built-in bench is none of this drive
    words = (tmp_path / "log.npz", "--side", "output")
    maps = ("--map", "time_s=t", "--map", "motor_angle_rad=q", "--map", "torque_nm=T")
    body = listing(*words, *maps, "--out", tmp_path / "out.csv", code=2)
    assert "--profile" in body["error"]["fix"]
    body = listing(*words)
    assert any(need.startswith("PROFILE.toml") for need in body["proposal"]["needs"])


_STATES = {"torque_nm": "effort", "motor_angle_rad": "position", "motor_velocity_rad_s": "velocity"}
_EMPS = {"time_s": "t", "motor_angle_rad": "qm*1000@zero", "torque_nm": "vir*35.15065188"}
_COGGING = {
    "motor_current_a": "Iq", "motor_angle_rad": "Position@zero", "motor_velocity_rad_s": "Velocity",
}  # fmt: skip


@needs_data
@pytest.mark.parametrize(
    ("raw", "prepared", "asked"),
    [
        ("emps.mat", "emps", Recipe(map=_EMPS, velocity_from_angle_hz=60.0)),
        ("cogging_1.txt", "cogging_1", Recipe(map=_COGGING, torque_constant_nm_per_a=2.5)),
        *(
            pytest.param(
                "ur10.db3", f"ur10_{j}", Recipe(map=_STATES, side="output", joint=j),
                marks=pytest.mark.skipif(not have("rosbags"), reason="library"),
            )
            for j in ("shoulder_pan_joint", "wrist_2_joint", "wrist_3_joint")
        ),
    ],
)  # fmt: skip
def test_originals_give_the_numbers_of_the_prepared_traces(raw, prepared, asked, tmp_path):
    import_files(asked, [REAL / "raw" / raw], tmp_path / "out.csv", gear_ratio=100.0)
    trace, known = read_trace(tmp_path / "out.csv"), read_trace(REAL / f"{prepared}.csv.gz")
    for name, values in known.columns.items():
        # the prepared ones are rounded to eight digits
        assert np.max(np.abs(trace[name] - values)) < 1e-6 * np.max(np.abs(values)), name


@needs_data
def test_a_log_without_time_asks_for_the_rate_and_takes_it(tmp_path):
    file, out = REAL / "raw" / "kuka_med.csv", tmp_path / "out.csv"
    asked = Recipe(map={"torque_nm": "tau_0", "motor_angle_rad": "q_0"})
    with pytest.raises(DataError) as caught:
        import_files(asked, [file], out)
    assert "--rate" in caught.value.fix
    timed = Recipe(map=asked.map, rate_hz=100.0, velocity_from_angle_hz=10.0)
    assert import_files(timed, [file], out).rows == len(file.read_text().splitlines()) - 1
