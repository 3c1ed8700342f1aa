"""Logs as labs have them: names and units decide, and what cannot be told is refused or asked."""

from pathlib import Path

import numpy as np
import pytest

from hdbench.diagnosis.inspection import inspect_log, read_log
from hdbench.errors import HdbenchError
from hdbench.importing.importer import import_files
from hdbench.importing.listing import list_channels
from hdbench.importing.proposal import Proposal, proposed_mapping
from hdbench.importing.recipe import Recipe
from hdbench.importing.registry import open_source
from hdbench.importing.source import Channel, told_apart
from hdbench.importing.units import bare_name, stated_unit
from hdbench.profile import load_profile
from hdbench.records import Trace, read_trace

RPM, DEGREE = np.pi / 30.0, np.pi / 180.0
LVM = (
    "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\t\nChannels\t2\n"
    "Y_Unit_Label\tNcm\trpm\nX_Dimension\tTime\tTime\nX0\t0.0\t0.0\nDelta_X\t0.5\t0.5\n"
    "***End_of_Header***\t\t\t\nX_Value\tTorque\tSpeed\tComment\n"
)


def proposal_for(file: Path) -> Proposal:
    source = open_source(file)
    return proposed_mapping(list_channels(source), Recipe(), source.channels)


def taken(tmp_path: Path, content: str, encoding: str = "utf-8", ratio: float = 50.0) -> Trace:
    """Write a log, take what is proposed for it, and return the trace."""
    file, out = tmp_path / "log.csv", tmp_path / "out.csv"
    file.write_bytes(content.encode(encoding))
    proposal = proposal_for(file)
    assert all(need.startswith("PROFILE") for need in proposal.needs)
    import_files(proposal.taken(), [file], out, gear_ratio=ratio)
    return read_trace(out, require=())


def table(head: str, mark: str = ",", comma: bool = False) -> str:
    """Return rows of 0, 500 ...; 100, 101 ...; 90, 180 ... below a head."""
    rows = [f"{500 * k}.0{mark}{100 + k}.0{mark}{90 * (k + 1)}.0" for k in range(9)]
    body = "\n".join(rows)
    return head + (body.replace(".", ",") if comma else body) + "\n"


@pytest.mark.parametrize(
    ("content", "encoding"),
    [
        (table("time_ms,torque_Ncm,speed_rpm\n"), "utf-8"),
        (table("Time,Torque,Speed\nms,Ncm,rpm\n"), "utf-8"),
        (table("Zeit [ms];Drehmoment [Ncm];Drehzahl [1/min]\n", ";", True), "utf-8"),
        (table("Prüfstand 3;;\nZeit in ms;Drehmoment / Ncm;Drehzahl, rpm\n", ";", True), "cp1252"),
        (table("Zeit [ms]\tMoment [N·cm]\tDrehzahl [U/min]\n", "\t", True), "utf-16"),
        (table("time_ms,torque_Ncm,speed_rpm\n") + "5000,,\n", "utf-8"),
        (LVM + "".join(f"{0.5 * k}\t{100 + k}\t{90 * (k + 1)}\n" for k in range(9)), "utf-8"),
    ],
    ids=["suffix", "units", "brackets", "stroke and blank", "utf-16", "short last row", "labview"],
)
def test_units_are_read_wherever_they_stand(tmp_path, content, encoding):
    trace = taken(tmp_path, content, encoding)
    np.testing.assert_allclose(trace.time_s[:9], 0.5 * np.arange(9), rtol=1e-15)
    np.testing.assert_allclose(trace["torque_nm"][:9], 1.0 + 0.01 * np.arange(9), rtol=1e-15)
    velocity = 90.0 * (1.0 + np.arange(9)) * RPM
    np.testing.assert_allclose(trace["motor_velocity_rad_s"][:9], velocity, rtol=1e-15)


@pytest.mark.parametrize(
    "stamp",
    [
        "2024-03-12T10:11:{:06.3f}Z",
        "2024-03-12 10:11:{:06.3f}+01:00",
        "12.03.2024 10:11:{:06.3f}",
        "2024/03/12 10:11:{:06.3f}",
        "10:11:{:06.3f}",
    ],
)
def test_stamps_become_seconds(tmp_path, stamp):
    rows = "".join(f"{stamp.format(58 + 0.2 * k)},{k}\n" for k in range(9))
    trace = taken(tmp_path, f"Stamp,Torque (Nm)\n{rows}")
    np.testing.assert_allclose(trace.time_s, 0.2 * np.arange(9), rtol=1e-15)


def test_a_stamp_of_another_day_or_of_no_sure_order_is_refused(tmp_path):
    for stamps, word in (
        (("23:59:59.9", "00:00:00.1"), "goes back"),
        (("3/12/2024 10:11:12", "3/12/2024 10:11:13"), "or a stamp such as"),
        (("2024-02-30 10:11:12", "2024-02-30 10:11:13"), "or a stamp such as"),
    ):
        file = tmp_path / "log.csv"
        file.write_text("Stamp,Torque\n" + "".join(f"{stamp},1\n" for stamp in stamps))
        asked = Recipe(map={"time_s": "Stamp", "torque_nm": "Torque"})
        with pytest.raises(HdbenchError, match=word):
            import_files(asked, [file], tmp_path / "out.csv")
        assert list(tmp_path.iterdir()) == [file]


def test_what_is_named_behind_the_gear_is_turned_by_its_ratio(tmp_path):
    head = "time_ms,torque_Nm,joint_velocity (deg/s)\n"
    trace = taken(tmp_path, table(head))
    velocity = 50.0 * 90.0 * (1.0 + np.arange(9)) * DEGREE
    np.testing.assert_allclose(trace["motor_velocity_rad_s"], velocity, rtol=1e-15)
    file = tmp_path / "both.csv"
    file.write_text("time,q_link[rad],dq_motor[rad/s],tau[Nm]\n0,1,2,3\n1,2,3,4\n")
    asked = proposal_for(file)
    assert asked.recipe.map["motor_angle_rad"].endswith("@output")
    assert not asked.recipe.map["motor_velocity_rad_s"].endswith("@output")
    assert "--profile" in asked.extra


def test_a_voltage_is_no_torque_and_an_unknown_unit_asks_for_its_factor(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text(table("time_ms,torque_mV,speed_rpm\n"))
    assert proposal_for(file).recipe.map["torque_v"] == "torque_mV@mV"
    file.write_text(table("time_ms,torque (furlong),speed_rpm\n"))
    asked = proposal_for(file)
    assert asked.recipe.map["torque_nm"] == "torque (furlong)*TORQUE_NM_FACTOR"
    assert any("furlong" in need for need in asked.needs)
    plain = Recipe(map={"time_s": "1*0.001", "torque_nm": "2"})
    with pytest.raises(HdbenchError, match="states furlong"):
        import_files(plain, [file], tmp_path / "out.csv")


def test_a_remark_in_a_row_loses_neither_row_nor_names(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    rows = [["A bench, in March"], [], ["Time [ms]", "Torque [Ncm]", "Speed [rpm]", "Remark"]]
    rows += [[500.0 * k, 100.0 + k, 90.0, "start" if k == 0 else None] for k in range(9)]
    for row in rows:
        book.active.append(row)
    book.save(tmp_path / "log.xlsx")
    source = open_source(tmp_path / "log.xlsx")
    names = ["Time [ms]", "Torque [Ncm]", "Speed [rpm]", "Remark"]
    assert [channel.name for channel in source.channels] == names
    assert sum(len(piece[names[0]]) for piece in source.pieces(names)) == 9
    source.close()


def test_a_row_of_units_may_end_before_the_names(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("time,torque,a,b\nms,Ncm\n" + "1,2,3,4\n" * 9)
    channels = open_source(file).channels
    told = [("time", "ms"), ("torque", "Ncm"), ("a", ""), ("b", "")]
    assert [(channel.name, channel.unit) for channel in channels] == told


def test_a_unit_of_control_characters_is_spelled():
    (channel,) = told_apart(Path("x"), [Channel("torque", "Nm\0\n" + 90 * "x")])
    assert channel.unit.startswith(r"Nm\x00\nxx")
    assert len(channel.unit) == 40


def test_counts_stay_counts_until_somebody_gives_their_scale(tmp_path):
    load = np.random.default_rng(1).integers(-20, 20, 400) % 65536
    rows = "".join(f"{0.01 * k:.2f},{value},{k % 5}\n" for k, value in enumerate(load))
    file, out = tmp_path / "log.csv", tmp_path / "out.csv"
    file.write_text("time_s,load,speed\n" + rows)
    told = proposal_for(file)
    assert told.recipe.map["torque_nm"] == "load*N_M_PER_COUNT@int16"
    asked = {"time_s": "time_s", "torque_nm": "load*1@int16", "motor_velocity_rad_s": "speed"}
    import_files(Recipe(map=asked), [file], out)
    for log in (read_log(file), read_log(out)):
        findings = inspect_log(log, load_profile("cim-tr-97-06").data).findings
        assert "no-scale" in [finding.name for finding in findings]


TIME = 0.01 * np.arange(400)
SWING = 60.0 * np.sin(np.pi * TIME)
TURNED = np.cumsum(SWING) * 0.01


@pytest.mark.parametrize(
    ("head", "columns", "mapped", "asked"),
    [
        ("timestamp", (1.7639e12 + 1000.0 * TIME,), "@ms", ""),
        ("time", (1000.0 * TIME,), "@TIME_UNIT", "0.1 Hz"),
        ("t,position,velocity", (TIME, TURNED, SWING), "position", ""),
        ("t,position,velocity", (TIME, TURNED / 50.0, SWING), "_FACTOR", "50"),
        ("t,position,velocity", (TIME, np.rint(4e3 * TURNED), SWING), "_FACTOR", "not in the file"),
        ("t,angle [deg],speed [rpm]", (TIME, TURNED / DEGREE, SWING / RPM), "@deg", ""),
        ("t,angle [deg],speed [rpm]", (TIME, TURNED, SWING / RPM), "@deg", "57.3"),
        ("t,joint1_pos,joint1_vel", (TIME, TURNED, SWING), "joint1_pos", "gear ratio"),
        ("t,Winkel [rad],Abtriebsdrehzahl [rpm]", (TIME, TURNED, SWING), "@output", "gear ratio"),
    ],
)
def test_units_and_sides_are_asked_for_where_data_or_names_tell_of_others(
    head, columns, mapped, asked, tmp_path
):
    table = np.column_stack([*columns, np.cos(SWING)])
    file = tmp_path / "log.csv"
    np.savetxt(file, table, "%.12g", ",", header=f"{head},torque [Nm]", comments="")
    proposal = proposal_for(file)
    assert mapped in " ".join(proposal.recipe.map.values())
    assert asked in " ".join(proposal.needs)
    assert bool(asked) == bool(proposal.needs)


@pytest.mark.parametrize(("share", "told"), [(1.0, ""), (0.02, "50"), (-1.0, "-1")])
def test_a_velocity_that_is_not_the_rate_of_its_angle_is_told(share, told, tmp_path):
    file, out = tmp_path / "log.csv", tmp_path / "out.csv"
    table = np.column_stack([TIME, share * TURNED, SWING, np.cos(SWING)])
    names = "time_s,motor_angle_rad,motor_velocity_rad_s,torque_nm"
    np.savetxt(file, table, delimiter=",", header=names, comments="")
    notes = import_files(Recipe(), [file], out).notes
    doubts = [note for note in notes if note.startswith("doubtful")]
    found = inspect_log(read_log(out), load_profile("cim-tr-97-06").data).findings
    unlike = [finding.detail for finding in found if finding.name == "units-disagree"]
    assert len(doubts) == len(unlike) == bool(told)
    assert all(f" {told}" in f" {text}" for text in [*doubts, *unlike])
    assert "3.99 s at 100 Hz" in notes


def test_titles_stay_out_of_names_and_a_merged_cell_names_all_its_columns(tmp_path):
    file = tmp_path / "log.csv"
    head = "Bench 3;;;;\nDate;1.2.2026;;;\n;;;;\n;Motor;;Sensor;\n"
    names = "Zeit;Drehzahl;Winkel;Moment;Remark\nms;1/min;deg;Nm;\n"
    file.write_text(head + names + "0;1;2;3;start\n" + "1;1;2;3;\n" * 9)
    channels = open_source(file).channels
    told = ["Zeit", "Motor/Drehzahl", "Motor/Winkel", "Sensor/Moment", "Sensor/Remark"]
    assert [channel.name for channel in channels] == told
    assert [channel.unit for channel in channels] == ["ms", "1/min", "deg", "Nm", ""]


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("AIN0 (mV)", "AIN0", "mV"),
        ("AIN0", "AIN0", ""),
        ("speed_rpm", "speed", "rpm"),
        ("rpm", "rpm", "rpm"),
        ("min", "min", ""),
        ("vel_deg_per_s", "vel", "deg/s"),
        ("Torque / Nm", "Torque", "Nm"),
        ("torque_oz_in", "torque", "oz_in"),
        ("q_2_deg", "q_2", "deg"),
        ("effort[3]", "effort[3]", ""),
        ("speed_min", "speed_min", ""),
        ("phase_a", "phase_a", ""),
    ],
)
def test_names_and_units_of_headers(header, name, unit):
    assert (bare_name(header), stated_unit(header)) == (name, unit)
