"""Files of LabJack and DATAQ loggers come in as they are: table found, time, units, commas."""

import math
from datetime import UTC, datetime

import pytest

from hdbench.errors import DataError, UsageError
from hdbench.importing.importer import import_files
from hdbench.importing.layout import EPOCH_1904_S, text_layout
from hdbench.importing.recipe import Recipe
from hdbench.importing.units import is_time_name, target_unit, unit_scale
from hdbench.records import read_trace

# date, time, a line of five words per channel, names, numbers: LJStreamUD's layout
STREAM = (
    "12/9/2013\r\n7:28:06 PM\r\n"
    "CH0:\tAIN0\tRange\t10\ty=a\r\nCH1:\tAIN1\tRange\t10\ty=b*2\r\n\r\n"
    "Time\tv0\tv1\ty0\ty1\r\n"
    "0.000\t0.125\t1.5\t0.125\t3.0\r\n0.001\t0.250\t1.6\t0.250\t3.2\r\n"
    "0.002\t0.375\t1.7\t0.375\t3.4\r\n"
)
WINDAQ = (
    '"bridge.wdq"\n"11/21/2026 10:15:00"\n\n'
    '"Relative Time","Torque","Tacho"\n"sec","mV","Volt"\n'
    "0.000,125.0,1.5\n0.010,250.0,1.6\n0.020,,1.7\n"
)


def brought(tmp_path, text, logger, *maps):
    source = tmp_path / "log.dat"
    source.write_bytes(text.encode())
    recipe = Recipe(map=dict(maps), from_logger=logger)
    return import_files(recipe, [source], tmp_path / "trace.csv")


BOTH = (("torque_v", "v0"), ("tacho_v", "v1"))


@pytest.mark.parametrize("logger", ["auto", "labjack"])
def test_a_labjack_stream_file_is_found_behind_its_channel_lines(tmp_path, logger):
    report = brought(tmp_path, STREAM, logger, *BOTH)
    trace = read_trace(report.out)
    assert trace["time_s"].tolist() == [0.0, 0.001, 0.002]
    assert trace["torque_v"].tolist() == [0.125, 0.25, 0.375]
    assert trace["tacho_v"].tolist() == [1.5, 1.6, 1.7]
    # which input is v0 stands only there
    assert any("AIN0" in note for note in report.notes)


def test_a_labjack_log_counts_from_1904_and_the_trace_from_its_start(tmp_path):
    text = "Time\tv0\tv1\n3469490886.250000\t0.1\t1.0\n3469490886.500000\t0.2\t1.1\n"
    report = brought(tmp_path, text, "labjack", *BOTH)
    assert read_trace(report.out)["time_s"].tolist() == [0.0, 0.25]
    # 2013-12-10T03:28:06Z is 1386646086 s since 1970, and 1904 lies 2082844800 s before that
    assert report.time_origin_s == 3469490886.25
    assert datetime(1904, 1, 1, tzinfo=UTC).timestamp() == -EPOCH_1904_S
    assert any("2013-12-10T03:28:06Z" in note for note in report.notes)


@pytest.mark.parametrize("logger", ["auto", "dataq"])
def test_a_windaq_export_with_a_line_of_units_is_brought_in_in_volts(tmp_path, logger):
    report = brought(tmp_path, WINDAQ, logger, ("torque_v", "Torque"), ("tacho_v", "Tacho"))
    trace = read_trace(report.out)
    assert trace["time_s"].tolist() == [0.0, 0.01, 0.02]
    assert trace["torque_v"][:2].tolist() == [0.125, 0.25]
    assert math.isnan(trace["torque_v"][2])
    assert report.lost == 1
    assert any("mV" in note and "0.001" in note for note in report.notes)


def test_commas_as_decimals_semicolons_a_byte_order_mark_and_bracketed_units(tmp_path):
    text = (
        "\ufeffAufnahme;21.11.2026\r\nTime (ms);Drehmoment [mV];Drehzahl [rpm]\r\n"
        "0,0;125,0;300,0\r\n0,5;250,0;600,0\r\n"
    )
    maps = (("torque_v", "Drehmoment"), ("motor_velocity_rad_s", "Drehzahl [rpm]"))
    trace = read_trace(brought(tmp_path, text, "auto", *maps).out)
    assert trace["time_s"].tolist() == [0.0, 0.0005]
    assert trace["torque_v"].tolist() == [0.125, 0.25]
    # 300 turns a minute are five a second
    assert trace["motor_velocity_rad_s"] == pytest.approx([10 * math.pi, 20 * math.pi], rel=1e-15)


def test_a_scale_given_by_hand_goes_before_the_stated_unit(tmp_path):
    maps = (("torque_v", "Torque*2"), ("tacho_v", "Tacho"))
    assert read_trace(brought(tmp_path, WINDAQ, "dataq", *maps).out)["torque_v"][0] == 250.0


def test_a_stated_unit_of_another_quantity_is_refused_with_its_column(tmp_path):
    text = "Time (s),speed (rpm)\n0,1\n1,2\n"
    with pytest.raises(UsageError) as caught:
        brought(tmp_path, text, "auto", ("torque_v", "speed"))
    assert "rpm" in caught.value.what
    assert "V" in caught.value.what


def test_without_a_logger_a_stated_unit_is_not_taken_for_ours(tmp_path):
    source = tmp_path / "log.csv"
    source.write_text("t,speed (rpm),torque_nm\n0,300,1\n1,300,2\n")
    maps = {"time_s": "t", "motor_velocity_rad_s": "speed (rpm)"}
    with pytest.raises(UsageError) as caught:
        import_files(Recipe(map=maps), [source], tmp_path / "out.csv")
    told = caught.value.fix.partition("*")[2].partition(";")[0]
    scaled = {**maps, "motor_velocity_rad_s": f"speed (rpm)*{told}"}
    report = import_files(Recipe(map=scaled), [source], tmp_path / "out.csv")
    assert read_trace(report.out)["motor_velocity_rad_s"][0] == pytest.approx(10 * math.pi)


def test_a_file_without_a_named_time_says_how_to_go_on(tmp_path):
    with pytest.raises(DataError, match=r"fix: .*--no-header"):
        brought(tmp_path, "1.0,2.0\n1.1,2.1\n", "dataq", ("torque_v", "1"))


def test_a_time_of_day_is_counted_in_seconds(tmp_path):
    text = "Date,Time,Torque\n11/21/2026,10:15:00.0,1.0\n11/21/2026,10:15:00.1,1.1\n"
    report = brought(tmp_path, text, "dataq", ("torque_v", "Torque"), ("time_s", "Time"))
    assert read_trace(report.out, require=()).time_s.tolist() == [0.0, 0.1]


def test_names_of_a_time():
    names = ("Time", "time_s", "Relative Time", "Timestamp", "Time (ms)")
    others = ("timing", "v0", "runtime", "")
    assert [name for name in (*names, *others) if is_time_name(name)] == [*names]


def test_layout_keeps_what_stands_before_the_table():
    layout = text_layout(STREAM.replace("\r", "").split("\n"))
    assert (layout.delimiter, layout.start, layout.units) == ("\t", 6, ())
    assert layout.names == ("Time", "v0", "v1", "y0", "y1")
    assert layout.preamble == (0, 1, 2, 3)


@pytest.mark.parametrize(
    ("unit", "wanted", "scale"),
    [
        *(("mV", "V", 0.001), ("ms", "s", 0.001), ("lb", "kg", 0.45359237)),
        *(("N·m", "N m", 1.0), ("N-m", "N m", 1.0), ("Ncm", "N m", 0.01)),
        *(("deg", "rad", math.radians(1.0)), ("rpm", "rad/s", math.pi / 30.0)),
    ],
)
def test_scales_of_units(unit, wanted, scale):
    assert float(unit_scale(unit, wanted)) == pytest.approx(scale, rel=1e-15)


def test_unknown_units_are_not_judged():
    assert unit_scale("counts", "V") is None
    assert unit_scale("rpm", "V").is_nan()


def test_units_of_our_columns():
    found = [target_unit(n) for n in ("motor_velocity_rad_s", "time_s", "torque_nm", "range")]
    assert found == ["rad/s", "s", "N m", ""]
