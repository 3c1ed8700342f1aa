"""Other programs' logs become traces and loads with the same numbers."""

import csv
from fractions import Fraction

import numpy as np
import pytest
from publicdata import DATA, needs_data

from hdbench.errors import DataError, UsageError
from hdbench.importing.importer import import_files
from hdbench.importing.readers import text as text_module
from hdbench.importing.recipe import Recipe, known_columns, parse_entry
from hdbench.records import read_loads, read_trace


def bring(tmp_path, texts, maps, *, kind="trace", constants=(), **options):
    files = []
    for number, text in enumerate(texts):
        path = tmp_path / f"in{number}.txt"
        path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
        files.append(path)
    mapped, fixed = (dict(t.split("=", 1) for t in texts) for texts in (maps, constants))
    plan = Recipe(kind, mapped, fixed, **options)
    out = tmp_path / "out.csv"
    report = import_files(plan, files, out)
    found = read_trace(out, require=("torque",)) if kind == "trace" else read_loads(out, None)
    return found, report


MAPS = ("time_s=t", "torque_nm=T", "motor_velocity_rad_s=v")


@pytest.mark.parametrize(
    "text",
    [
        "t,T,v\n5,1.5,2\n6,2.5,3\n",
        "\ufefft;T;v\r\n5;1,5;2\r\n6;2,5;3\r\n",
        "t\tT\tv\n5\t1.5\t2\n6\t2.5\t3\n",
        't,T,v\n"5","1.5","2"\n6,2.5,3,\n\n',
        "t; T; v\n5; 1,5; 2\n6; 2,5; 3",
    ],
)
def test_separators_decimal_commas_and_byte_order_marks_do_not_change_a_number(tmp_path, text):
    trace, report = bring(tmp_path, [text], MAPS)
    assert trace.time_s.tolist() == [0.0, 1.0]
    assert trace["torque_nm"].tolist() == [1.5, 2.5]
    assert trace["motor_velocity_rad_s"].tolist() == [2.0, 3.0]
    assert report.time_origin_s == 5.0


def test_columns_go_by_number_where_there_is_no_header_and_lines_are_skipped(tmp_path):
    text = "made by a logger\nsecond line\n1000,7,9\n1010,8,9\n"
    maps = ("time_s=1*0.001", "torque_v=2")
    trace, _ = bring(tmp_path, [text], maps, no_header=True, skip=2)
    assert trace.time_s.tolist() == [0.0, 0.01]
    assert trace["torque_v"].tolist() == [7.0, 8.0]


def test_scale_and_offset_are_computed_in_decimals(tmp_path):
    text = "t,T-3*2,rpm\n0,0.1,60\n1,0.3,30\n"
    maps = ("time_s=t", "torque_nm=T-3*2*10-1", "motor_velocity_rad_s=rpm/60")
    trace, _ = bring(tmp_path, [text], maps)
    # 0.3 * 10 - 1 is 2 in decimals, and 2.0000000000000004 or so in doubles of another order
    assert trace["torque_nm"].tolist() == [0.0, 2.0]
    assert trace["motor_velocity_rad_s"].tolist() == [1.0, 0.5]


def test_differences_of_large_times_keep_the_digits_of_the_file(tmp_path):
    cells = ["1763720000.000001", "1763720000.001002", "1763720000.002003"]
    text = "t,T\n" + "".join(f"{cell},1\n" for cell in cells)
    trace, _ = bring(tmp_path, [text], ("time_s=t", "torque_nm=T"))
    start = Fraction(cells[0])
    assert trace.time_s.tolist() == [float(Fraction(cell) - start) for cell in cells]
    kept, report = bring(tmp_path, [text], ("time_s=t", "torque_nm=T"), keep_time=True)
    assert kept.time_s.tolist() == [float(cell) for cell in cells]
    assert report.time_origin_s is None


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_rows_of_plain_numbers_are_read_to_the_same_bits_as_row_by_row(tmp_path, monkeypatch, mark):
    monkeypatch.setattr(text_module, "_CHUNK_BYTES", 500)
    rng = np.random.default_rng(3)
    rows = []
    for k, v in enumerate(rng.normal(size=300) * 1e3):
        angle = "" if k % 50 == 7 else f"{v}"
        rows.append([f"{1763720000 + 0.0005 * k:.4f}", repr(float(v)), f"{v:.3f}", angle])
    maps = ("time_s=1", "torque_nm=2", "motor_velocity_rad_s=3*0.001+2", "motor_angle_rad=4@deg")
    found = []
    # quotes, a comment or a blank line in the middle: from there on it goes row by row
    for odd, quote in ((0, ""), (0, '"'), (150, ""), (299, "")):
        lines = [mark.join(f"{quote}{cell}{quote}" for cell in row) for row in rows]
        lines[odd] = f"# a comment\n\n{lines[odd]}" if odd else lines[odd]
        text = "\n".join([mark.join(("t", "T", "v", "p")), *lines])
        if mark == ";":
            text = text.replace(".", ",")
        trace, _ = bring(tmp_path, [text], maps)
        found.append([trace[name].tobytes() for name in trace.columns])
    assert found.count(found[0]) == len(found)


@pytest.mark.parametrize(
    "more",
    ["", ', "w": "a},{b"', ', "parts": [{"k": 1}, {"k": 2}]', ', "i": {"k": 1}', ', "x": NaN'],
)
def test_records_of_json_are_read_alike_whatever_else_is_in_them(tmp_path, more):
    records = [f'{{"t": {0.001 * k!r}, "T": {k}.25{more}}}' for k in range(500)]
    trace, _ = bring(tmp_path, [f"[{', '.join(records)}]"], ("time_s=t", "torque_nm=T"))
    assert trace.time_s.tolist() == [0.001 * k for k in range(500)]
    assert trace["torque_nm"].tolist() == [k + 0.25 for k in range(500)]


def test_a_sample_rate_stands_for_a_time_column(tmp_path):
    trace, _ = bring(tmp_path, ["T\n1\n2\n", "T\n3\n"], ("torque_nm=T",), rate_hz=1000.0)
    assert trace.time_s.tolist() == [0.0, 0.001, 0.002]
    assert trace["torque_nm"].tolist() == [1.0, 2.0, 3.0]


def test_several_traces_are_joined_in_the_order_of_their_times(tmp_path):
    late, early = "t,T\n10,3\n11,4\n", "t,T\n0,1\n1,2\n"
    trace, _ = bring(tmp_path, [late, early], ("time_s=t", "torque_nm=T"))
    assert trace.time_s.tolist() == [0.0, 1.0, 10.0, 11.0]
    assert trace["torque_nm"].tolist() == [1.0, 2.0, 3.0, 4.0]


def test_traces_that_overlap_are_refused(tmp_path):
    with pytest.raises(DataError, match="follow one another"):
        bring(tmp_path, ["t,T\n0,1\n5,2\n", "t,T\n5,1\n6,2\n"], ("time_s=t", "torque_nm=T"))


def test_each_file_can_have_its_own_column_and_constant(tmp_path):
    texts = ["a,x\n1,2\n", "b,x\n3,4\n"]
    maps = ("1:torque_nm=a", "2:torque_nm=b*-1", "reading_v=x")
    constants = ("experiment=e", "position_rad=0.5", "range=full", "direction=cw", "1:series=up")
    both = (*constants, "2:series=down")
    loads, report = bring(tmp_path, texts, maps, kind="loads", constants=both)
    found = [(r.torque_nm, r.reading_v, r.series, r.position_rad) for r in loads.readings]
    assert found == [(1.0, 2.0, "up", 0.5), (-3.0, 4.0, "down", 0.5)]
    assert report.rows == 2
    with pytest.raises(UsageError, match="series for file 2"):
        bring(tmp_path, texts, maps, kind="loads", constants=constants)


def test_columns_that_bear_a_name_of_the_contract_come_along(tmp_path):
    trace, _ = bring(tmp_path, ["time_s;torque_nm;other\n0;1;2\n1;1;2\n"], ())
    assert list(trace.columns) == ["time_s", "torque_nm"]


def test_a_missing_number_is_a_lost_sample_and_counted(tmp_path):
    trace, report = bring(tmp_path, ["t,T,v\n0,,1\n1,NaN,2\n2,3,4\n"], MAPS)
    assert np.isnan(trace["torque_nm"]).tolist() == [True, True, False]
    assert report.lost == 2


@pytest.mark.parametrize(
    ("text", "place", "word"),
    [
        ("t,T,v\n0,1,2\n0,1,2\n", "in0.txt:3", "repeats"),
        ("t,T,v\n0,1,2\n5,1,2\n4,1,2\n", "in0.txt:4", "goes back"),
        ("t,T,v\n0,1,2\n,1,2\n", "in0.txt:3", "no time"),
        ("t,T,v\n0,1,2\n1,x,2\n", "in0.txt:3", "'x'"),
        ("t,T,v\n0,1,2\n1,inf,2\n", "in0.txt:3", "'inf'"),
        ("t,T,v\n0,1,2\n1,1e400,2\n", "in0.txt:3", "'1e400'"),
        ("t,T,v\n0,1,2\n1,2\n", "in0.txt:3", "2 cells"),
        ("t,T,v\n0,1,2\n", "in0.txt", "1 row"),
        ("t,T,v\n0,nan,2\n1,,2\n", "in0.txt", "T holds no number in 2 rows"),
        ("t,T,v\n", "in0.txt", "no data"),
        ("", "in0.txt", "no data"),
        (b"t,T,v\n0,\xff,1\n", "in0.txt:2", "'ÿ'"),
    ],
)
def test_a_bad_log_is_refused_with_its_line(tmp_path, text, place, word):
    with pytest.raises(DataError, match=rf"\A.*{place}: .*{word}"):
        bring(tmp_path, [text], MAPS)
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(
    ("maps", "constants", "word"),
    [
        (("time_s=t", "torque_nm=Tork"), (), "'Tork'"),
        (("time_s=t", "torque_nm=T*0"), (), "scale 0"),
        (("time_s=t", "torque_nm=T"), ("torque_nm=3",), "both"),
        (("time_s=t", "torque_nm=T"), ("2:temperature_c=3",), "file 2"),
        (("time_s=t", "torque_nm=T"), ("temperature_c=warm",), "'warm'"),
    ],
)
def test_a_plan_that_does_not_fit_is_wrong_usage(tmp_path, maps, constants, word):
    with pytest.raises(UsageError, match=rf"\A.*: .*{word}"):
        bring(tmp_path, ["t,T\n0,1\n"], maps, constants=constants)


def test_a_file_without_a_time_asks_for_the_rate(tmp_path):
    with pytest.raises(DataError, match=r"no time column(.|\n)*fix: .*--rate"):
        bring(tmp_path, ["a,T\n0,1\n1,2\n"], ("torque_nm=T",))


def test_a_slip_in_a_column_name_of_the_contract_is_told():
    with pytest.raises(UsageError, match=r"fix: .*torque_nm"):
        parse_entry("--map", "torqe_nm=T", known_columns("trace"))
    with pytest.raises(UsageError):
        parse_entry("--set", "series", known_columns("loads"))


def test_a_failed_import_leaves_the_old_file_and_nothing_else(tmp_path):
    out = tmp_path / "out.csv"
    out.write_text("old")
    source = tmp_path / "in.csv"
    source.write_text("t,x\n0,1\n")
    with pytest.raises(DataError, match="torque"):
        import_files(Recipe(map={"time_s": "t"}), [source], out)
    assert out.read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.csv", "out.csv"]
    with pytest.raises(UsageError, match="inputs"):
        import_files(Recipe(map={"time_s": "t"}), [source], source)


@needs_data
def test_the_torque_arm_of_unh_gives_the_published_lines(tmp_path):
    folder = DATA / "unh_torque_arm_cal"
    files = [folder / f"torque_arm_{series}.csv" for series in ("ascending", "descending")]
    maps = {"torque_nm": "mean_torque", "reading_v": "mean_volts_per_volt"}
    same = {"experiment": "arm", "position_rad": "0", "range": "full", "direction": "cw"}
    constants = {**same, "1:series": "up", "2:series": "down"}
    out = tmp_path / "loads.csv"
    import_files(Recipe("loads", maps, constants), files, out)
    readings = read_loads(out, None).readings

    def slope(*series):
        chosen = [r for r in readings if r.series in series]
        return np.polyfit([r.reading_v for r in chosen], [r.torque_nm for r in chosen], 1)

    # published beside the data with five decimals or more; a line fit keeps nine digits here
    assert slope("up", "down") == pytest.approx([123436.95673891163, -3.2081368832621706], rel=1e-9)
    assert slope("up")[0] == pytest.approx(123791.23183311448, rel=1e-9, abs=0)
    assert slope("down")[0] == pytest.approx(123108.06827582237, rel=1e-9, abs=0)


@needs_data
def test_the_sweep_of_lara8_comes_in_with_every_digit(tmp_path):
    source = DATA / "lara8_dual_encoder" / "validate_joint3_sweep.csv"
    maps = {
        "time_s": "Timestamp",
        "torque_nm": "joint_torque_current_3",
        "motor_velocity_rad_s": "joint_velocity_3*101",
    }
    out = tmp_path / "trace.csv.gz"
    report = import_files(Recipe(map=maps), [source], out)
    trace = read_trace(out)
    with source.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert report.rows == len(rows) == 1832
    assert trace["torque_nm"].tolist() == [float(row["joint_torque_current_3"]) for row in rows]
    start = Fraction(rows[0]["Timestamp"])
    assert trace.time_s.tolist() == [float(Fraction(row["Timestamp"]) - start) for row in rows]
    # one rounding of the product against two: half a unit in the last place each
    expected = [101 * float(row["joint_velocity_3"]) for row in rows]
    np.testing.assert_allclose(trace["motor_velocity_rad_s"], expected, rtol=3e-16, atol=0)
