"""Traces come back with the same bits; a broken file names line and column."""

import gzip
import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hdbench.errors import DataError
from hdbench.records import Trace, csvtext, read_trace, tracefile, write_trace

GOOD = "time_s,torque_nm,motor_velocity_rad_s\n0.0,1.5,10\n0.001,2.5,11\n0.002,3.5,12\n"


def put(tmp_path, text, name="t.csv"):
    path = tmp_path / name
    path.write_bytes(text.encode("utf-8") if isinstance(text, str) else text)
    return path


def refused(path, **options):
    with pytest.raises(DataError) as caught:
        read_trace(path, **options)
    assert caught.value.fix
    return caught.value


@pytest.fixture(params=["pydantic", "polars"])
def fast(request, monkeypatch):
    """Read every file by one of the fast ways, in short pieces."""
    if request.param == "polars":
        pytest.importorskip("polars", reason="optional: pip install 'hdbench[fast]'")
    least = 1 if request.param == "polars" else float("inf")
    monkeypatch.setattr(csvtext, "_WORTH_IMPORTING", least)
    monkeypatch.setattr(csvtext, "_CHUNK_BYTES", 200)


@given(
    st.lists(st.floats(allow_infinity=False, allow_nan=True, width=64), min_size=1, max_size=30),
    st.booleans(),
)
@settings(max_examples=60)
def test_a_written_trace_comes_back_with_the_same_bits(tmp_path_factory, values, packed):
    path = tmp_path_factory.mktemp("t") / ("t.csv.gz" if packed else "t.csv")
    torque = np.array(values)
    time_s = np.cumsum(np.full(len(values), 0.1))
    write_trace(path, Trace({"time_s": time_s, "torque_nm": torque, "tacho_v": -torque}))
    back = read_trace(path)
    assert list(back.columns) == ["time_s", "torque_nm", "tacho_v"]
    assert back.time_s.tobytes() == time_s.tobytes()
    # a NaN stands for a lost sample; its payload and sign carry no meaning
    expected = np.where(np.isnan(torque), np.nan, torque)
    assert back["torque_nm"].tobytes() == expected.tobytes()


def test_a_large_file_is_read_by_pieces_to_the_same_bits(tmp_path, monkeypatch):
    rows = "".join(f"{0.001 * k!r},{float(np.sin(k))!r},{k % 7}\n" for k in range(400))
    text = "time_s,torque_nm,motor_velocity_rad_s\n" + rows
    whole = read_trace(put(tmp_path, text))
    monkeypatch.setattr(tracefile, "_PIECE_BYTES", 1000)
    monkeypatch.setattr(csvtext, "read_raw", None)  # nothing reads the file at once
    parts = read_trace(put(tmp_path, text, "pieces.csv"))
    assert list(parts.columns) == list(whole.columns)
    assert all(parts[name].tobytes() == whole[name].tobytes() for name in whole.columns)
    monkeypatch.undo()
    monkeypatch.setattr(tracefile, "_PIECE_BYTES", 1000)
    assert refused(put(tmp_path, text + "0.4,x,1\n", "bad.csv")).where.endswith(":402")


@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize(
    "text", [GOOD, GOOD.replace("\n", "\r\n"), GOOD.replace("1.5", '"1.5"').replace("\n", "\r\n")]
)
def test_quotes_ends_of_lines_and_a_byte_order_mark_change_nothing(tmp_path, text, mark):
    plain, other = read_trace(put(tmp_path, GOOD)), read_trace(put(tmp_path, mark + text, "o.csv"))
    assert list(plain.columns) == list(other.columns)
    assert all(np.array_equal(plain[name], other[name]) for name in plain.columns)


def test_a_lost_sample_is_an_empty_cell_or_nan_and_stays_in_its_place(tmp_path, fast):
    path = put(tmp_path, GOOD.replace("2.5", "").replace("12", "nan"))
    trace = read_trace(path)
    assert trace.valid("torque_nm").tolist() == [True, False, True]
    assert trace.valid("motor_velocity_rad_s").tolist() == [True, True, False]


def test_unknown_columns_are_kept_and_text_is_kept_as_text(tmp_path, fast):
    text = 'time_s,torque_nm,tacho_v,humidity,note\n0,1,1,55,a\n1,1,1,56,"b,c"\n'
    trace = read_trace(put(tmp_path, text))
    assert trace["humidity"].tolist() == [55.0, 56.0]
    assert "note" not in trace
    out = tmp_path / "again.csv"
    write_trace(out, trace)
    assert read_trace(out).metadata["text_columns"] == {"note": ("a", "b,c")}


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        (GOOD.replace("2.5", "two"), ":3", ["torque_nm", "'two'"]),
        (GOOD.replace("2.5", "inf"), ":3", ["torque_nm", "infinite"]),
        (GOOD.replace("2.5", "1e999"), ":3", ["torque_nm", "infinite"]),
        (GOOD.replace("2.5", "1_000"), ":3", ["torque_nm", "'1_000'"]),
        (GOOD.replace("0.002", "0.001"), ":4", ["0.001", "strictly increasing"]),
        (GOOD.replace("0.002", ""), ":4", ["time_s"]),
        (GOOD.replace("0.002", "nan"), ":4", ["time_s"]),
        (GOOD.replace("3.5,12", "3.5"), ":4", ["2 cells", "needed: 3"]),
        (GOOD.replace("\n0.001,2.5,11", "\n\n0.001,2.5,x"), ":4", ["motor_velocity_rad_s"]),
        (GOOD.replace("2.5", '"2,5"'), ":3", ["torque_nm"]),
        (GOOD.replace("torque_nm", "time_s"), ":1", ["'time_s'", "twice"]),
        (GOOD.replace("torque_nm", ""), ":1", ["column 2"]),
        (GOOD.replace("torque_nm", "torque"), ":1", ["torque_nm or torque_v"]),
        (GOOD.replace("motor_velocity_rad_s", "speed"), ":1", ["tacho_v"]),
        (GOOD.replace("time_s", "t"), ":1", ["time_s"]),
        (GOOD.partition("\n")[2], ":1", ["numbers"]),
        (GOOD.partition("\n")[0], ":1", ["without data"]),
        ("", ":1", ["column names"]),
        ("\n\n", ":1", ["column names"]),
        (GOOD.replace(",", ";"), ":1", ["not separated by commas"]),
        (GOOD.replace("2.5", "2.5\0"), ":3", ["NUL"]),
        (GOOD.replace("2.5", '"2.5'), ":", ["CSV"]),
        (GOOD.encode() + b"0.003,\xff,1\n", ":5", ["UTF-8"]),
        (GOOD.replace("1,2.5,11\n0.002,3.5,12", "1,2.5,11,1\n0.002,3.5"), ":3", ["4 cells"]),
        (GOOD.removesuffix("\n") + ",", ":4", ["4 cells"]),
        (GOOD + '0.003,"4.5,13\n0.004,5.5,14\n0.005,6.5,15\n', ":5", ["CSV"]),
    ],
    ids=range(26),
)
def test_a_broken_file_names_line_and_column(tmp_path, fast, text, place, words):
    error = refused(put(tmp_path, text))
    assert f"t.csv{place}" in error.where
    assert all(word in error.what for word in words)
    assert "hdbench import" in error.fix or "separated" not in error.what


def test_what_is_required_can_be_chosen(tmp_path):
    path = put(tmp_path, "time_s,torque_nm\n0,1\n")
    assert len(read_trace(path, require=("torque",))) == 1
    assert "motor_angle_rad" in refused(path, require=("angle",)).what


@pytest.mark.parametrize("kind", ["missing", "folder", "fifo"])
def test_something_that_is_no_file_is_refused(tmp_path, kind):
    path = tmp_path / "x.csv"
    if kind == "folder":
        path.mkdir()
    if kind == "fifo":
        os.mkfifo(path)
    assert str(path) in refused(path).where


@pytest.mark.parametrize(
    "damage", [lambda raw: raw[:-20], lambda raw: raw[:30] + b"xx" + raw[32:], lambda _raw: b"no"]
)
def test_a_damaged_gzip_file_is_refused(tmp_path, damage):
    raw = gzip.compress((GOOD + "".join(f"{k},1,2\n" for k in range(1, 300))).encode())
    assert "gzip" in refused(put(tmp_path, damage(raw), "t.csv.gz")).what


def test_a_gzip_bomb_is_refused_before_it_fills_the_memory(tmp_path):
    path = put(tmp_path, gzip.compress(b"0" * (40 << 20), compresslevel=9), "t.csv.gz")
    assert "unpacks to more than" in refused(path).what


@pytest.mark.parametrize(
    "columns",
    [
        {"time_s": [0.0, 0.0], "torque_nm": [1.0, 2.0]},
        {"time_s": [0.0, np.nan], "torque_nm": [1.0, 2.0]},
        {"time_s": [0.0, 1.0], "torque_nm": [1.0, np.inf]},
        {"time_s": [0.0, 1.0], "torque_nm": [1.0]},
        {"time_s": [], "torque_nm": []},
    ],
)
def test_a_trace_that_could_not_be_read_again_is_not_written(tmp_path, columns):
    trace = Trace({name: np.array(values) for name, values in columns.items()})
    with pytest.raises(DataError):
        write_trace(tmp_path / "t.csv", trace)
    assert list(tmp_path.iterdir()) == []


# bytes, and words that mean something in a table
PIECES = st.binary(max_size=6) | st.sampled_from([b"nan", b"1e999", b'"', b"\0", b"\n", b"9" * 400])


@given(st.integers(0, len(GOOD)), st.integers(0, 6), PIECES)
@settings(max_examples=250)
def test_no_damage_ends_in_anything_but_a_trace_or_an_error(tmp_path_factory, at, cut, insert):
    path = tmp_path_factory.getbasetemp() / "fuzz.csv"
    path.write_bytes(GOOD.encode()[:at] + insert + GOOD.encode()[at + cut :])
    try:
        trace = read_trace(path)
    except DataError as error:
        told = (error.what, error.where, error.fix)
        assert all(told)
        return
    assert (np.diff(trace.time_s) > 0.0).all()
    assert all(len(column) == len(trace) for column in trace.columns.values())


def test_a_clean_trace_is_not_read_cell_by_cell(tmp_path, monkeypatch):
    def cell_by_cell(*_):
        raise AssertionError("the careful way is for what the fast way cannot read")

    monkeypatch.setattr(tracefile, "_careful", cell_by_cell)
    torque = np.random.default_rng(1).normal(size=1000)
    columns = {"time_s": np.arange(1000) * 1e-3, "torque_nm": torque, "tacho_v": np.ones(1000)}
    write_trace(tmp_path / "t.csv", Trace(columns))
    assert len(read_trace(tmp_path / "t.csv")) == 1000


# halves between two doubles, the ends of the range, and forms that JSON does not know
HARD = (
    *("9007199254740993", "9007199254740992.999999999999999999999", "123456789012345678901"),
    *("1e22", "1e23", "-0", "-0.0", "0", "-0e5", "nan", "NaN", "", "0.1", "0.30000000000000004"),
    *("2.2250738585072011e-308", "4.9e-324", "2.4703282292062328e-324", "1.7976931348623157e308"),
    *("+1.5", ".5", "5.", "007", "1E5", "1e-400", "1e0005", "5e-1", "-.5e+3"),
)


def test_the_fast_ways_read_the_bits_that_python_reads(tmp_path, fast):
    rng = np.random.default_rng(7)
    scale = 10.0 ** rng.integers(-300, 300, size=300)
    cells = [*HARD, *(repr(float(v)) for v in rng.normal(size=300) * scale)]
    # and decimals of too many digits, close to the middle between two doubles
    cells += [f"{np.nextafter(v, 2 * v) / 2 + v / 2:.25g}1" for v in rng.normal(size=300)]
    text = "time_s,torque_nm,tacho_v\n" + "".join(f"{k},{c},1\n" for k, c in enumerate(cells))
    found = read_trace(put(tmp_path, text))["torque_nm"]
    expected = np.array([float(cell or "nan") for cell in cells])
    same = found.view(np.int64) == expected.view(np.int64)
    assert [cell for cell, right in zip(cells, same, strict=True) if not right] == []
