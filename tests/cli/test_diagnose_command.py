"""`hdbench diagnose`: one JSON object with the contract's keys, exit codes, one screen of text."""

import io
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from recordlimits import LIMITS
from rich.console import Console
from runkit import ran
from swinging_shaft import record

from hdbench.model import catalogue
from hdbench.records import write_trace
from hdbench.report.diagnosis.limits import left_out_line, rest_line
from hdbench.results import DiagnosisResult
from hdbench_cli.commands.diagnosis_text import lines, names_line
from hdbench_cli.output import show_lines

# contract, section 5
CONTRACT = """schema hdbench_version profile verdict causes minor unexplained data_flags left_out
rest testable minimum_detectable simulated extended model_file"""
KEYS = set(CONTRACT.split())
LOADS = """experiment,position_rad,range,direction,series,torque_nm,reading_v
a,0,full,cw,up,0,0.01
a,0,full,cw,up,10,1.525
a,0,full,cw,up,20,3.04
a,0,full,cw,up,30,4.556
a,0,full,cw,up,35,5.31
"""


def trace_file(folder, amplitude_nm, change=lambda torque: None, n=6000):
    ripple = ((2.0, 0.4, 0.0), (5.5, amplitude_nm, 0.0))
    trace = record(motion=(90.0, 40.0, 6.0), ripple=ripple, n=n, seed=3)
    change(trace["torque_nm"])
    file = folder / "trace.csv"
    write_trace(file, trace)
    return file


@pytest.fixture
def diagnosed(answer, tmp_path):
    return partial(answer, "diagnose", "--out", tmp_path / "runs")


@pytest.fixture(scope="module")
def hidden(tmp_path_factory):
    """Return the folder of a trace with a hidden order, and what is told of it."""
    folder = tmp_path_factory.mktemp("hidden")
    words = ("diagnose", "--out", folder / "runs", "--json", "--check", trace_file(folder, 0.1))
    return folder, json.loads(ran(*words, code=3))


def test_a_hidden_order_is_one_json_object_with_the_contracts_keys(hidden):
    _, body = hidden
    assert set(body) >= KEYS
    assert body["schema"] == "hdbench/diagnosis/1"
    assert body["verdict"] == "named"
    (cause,) = body["causes"]
    # a hundredth of the resolution of 86 turns
    assert cause["parameters"]["order"]["value"] == pytest.approx(5.5, abs=1e-3)


def test_the_extended_model_continues_and_leaves_nothing_to_find(hidden, hdbench, tmp_path):
    folder, body = hidden
    assert Path(body["run_folder"], "model.json").samefile(body["model_file"])
    words = ("--check", "--model", body["model_file"], "--out", tmp_path)
    said = hdbench("diagnose", *words, folder / "trace.csv")[0]
    assert "Nothing found: what the simulation leaves looks like noise." in said


def test_a_failed_check_comes_before_doubtful_data(tmp_path, diagnosed):
    """Doubtful data alone exit 6: test_newcomer."""

    def harm(torque):
        torque[800:840] = np.nan

    body = diagnosed("--check", trace_file(tmp_path, 0.1, harm, n=1500), code=3)
    (flag,) = body["data_flags"]
    assert (flag["name"], flag["samples"]) == ("missed-samples", 40)


def test_loads_are_told_from_a_trace_by_their_columns(tmp_path, diagnosed):
    file = tmp_path / "loads.csv"
    file.write_text(LOADS)
    body = diagnosed(file)
    assert body["verdict"] == "cannot-tell"
    assert body["reason"]
    assert set(body) >= KEYS


def test_a_broken_cell_exits_4_with_file_and_line(tmp_path, diagnosed):
    file = tmp_path / "broken.csv"
    file.write_text("time_s,motor_velocity_rad_s,torque_nm\n0,1,0.5\n0.001,1,x\n")
    assert "broken.csv:3" in diagnosed(file, code=4)["error"]["where"]
    assert not (tmp_path / "runs").exists()


def test_list_causes_holds_the_contracts_names_of_what_is_searched(diagnosed):
    body = diagnosed("--list-causes")
    assert body["hdbench_version"]
    assert body["profile"] is None
    # held against the contract's list in tests/model
    assert [cause["name"] for cause in body["causes"]] == list(catalogue())
    for cause in body["causes"]:
        assert cause["equation"]
        assert all(parameter["unit"] for parameter in cause["parameters"])


def typed(body):
    """Return a result as its type."""
    return DiagnosisResult.from_json({"verdict": "nothing-found", **body}, "result.json")


def screen(body):
    """Return the lines of a result on a terminal of 80 columns."""
    console = Console(width=80, record=True, file=io.StringIO())
    show_lines(console, lines(typed(body), Path(body["run_folder"]), console))
    return console.export_text().splitlines()


def test_two_findings_fit_a_terminal_of_80_by_30(hidden):
    (cause,) = hidden[1]["causes"]
    causes = [{**cause, "separating_experiment": "two constant speeds"}] * 2
    body = {**hidden[1], "causes": causes}
    body["testable"] = LIMITS["testable"]
    assert len(screen(body)) <= 28
    # nothing of a record that is not whole is lost at the top
    lines = screen({**body, **LIMITS})
    assert lines[0].startswith("measured")
    assert lines[2].startswith("difference")
    assert len(lines) <= 30
    # a command to copy stays on one line
    assert max(len(line) for line in lines if not line.startswith("next ")) <= 80
    assert sum("told apart by" in line for line in lines) == 1


def test_what_was_left_out_left_over_and_not_testable_is_told():
    limits = typed(LIMITS)
    assert left_out_line(limits) == (
        "19 289 of 24 841 samples (78 %): the acceleration is not resolved (19 000), spikes (289)"
    )
    assert rest_line(limits) == ("0.119 N m left in noise of 0.043 N m: unexplained at velocity")
    assert names_line(limits) == (
        "2 of 8 names can be tested here; not: side-force, backlash, creep (the record has no "
        "load_torque_nm); mains-hum, tooth-mesh (torque low-passed at 10 Hz); crosstalk "
        "(the record has no motor_current_a)"
    )
    assert names_line(limits, 69) == (
        "2 of 8 names; not: 3 (the record has no load_torque_nm); 3 more"
    )


def test_nothing_is_told_of_limits_that_a_record_has_not():
    rest = {"heldout_rms_nm": 0.0501, "noise_rms_nm": 0.05, "told": []}
    full = typed({"rest": rest, "testable": [{"name": "spikes", "testable": True}]})
    assert (left_out_line(full), rest_line(full)) == ("", "")
    assert names_line(full) == "1 of 1 names can be tested here"
    # results of earlier versions hold none of them
    older = typed({})
    assert (left_out_line(older), rest_line(older), names_line(older)) == ("", "", "")
    unknown = typed({"rest": {**rest, "heldout_rms_nm": 0.1}})
    assert rest_line(unknown).endswith(": not located")
