"""The tables of a diagnosis can be read at any width; its limits stand with the verdict."""

import json
import shutil
from typing import Any

import pytest
from browser import browser, browser_program
from recordlimits import LIMITS, place

from hdbench.model import CauseTerm, cause_parameters
from hdbench.report import write_report
from hdbench.report.diagnosis.section import tables, verdict
from hdbench.results import DiagnosisResult

needs_browser = pytest.mark.skipif(browser_program() is None, reason="no Chromium on this machine")

# of each list of parameters: its height in lines, and its lines
LINES = """[...document.querySelectorAll('.stacked td:nth-child(2):not(:last-child)')].map(c => {
const s = getComputedStyle(c), [top, low, line] = [s.paddingTop, s.paddingBottom, s.lineHeight]
.map(parseFloat);
return [(c.clientHeight - top - low) / line, c.innerText.split('\\n').length]; })"""


@pytest.fixture(scope="module")
def cause(named_cause):
    """Return a function that makes a cause with names of its group and a rival."""

    def made(name: str, linear: tuple[float, ...], **shape: float) -> dict[str, object]:
        told = "four to six constant speeds over at least 1:4; a second encoder"
        group = {"group": [name, "wave-generator-eccentricity"], "separating_experiment": told}
        parameters = cause_parameters(CauseTerm(name, shape, linear))
        return named_cause(name, parameters, rivals=["load-dependent-friction"], **group)

    return made


@pytest.fixture(scope="module")
def found(cause) -> dict[str, Any]:
    return {
        "verdict": "named-and-unexplained",
        "causes": [
            cause("kinematic-error", (1e-4, 2e-4, 3e-4, 1e-4, 5e-5, 2e-5)),
            cause("bearing-defect", (0.1, 0.02, 0.03, 0.04, 0.01, 0.01), order=3.087),
            cause("ripple-harmonic", (0.12, 0.05), order=10.0),
        ],
        "unexplained": [place("velocity", "output-order")],
        **LIMITS,
    }


def result(found: dict[str, Any], **changes: object) -> DiagnosisResult:
    """Return the result with some keys changed."""
    return DiagnosisResult.from_json({**found, **changes}, "result.json")


def test_one_parameter_stands_on_a_line_and_a_wave_is_told_once(found, cause):
    table = tables(result(found))[0]
    name, parameters, speaks = table.rows[2]
    rivals = ["or wave-generator-eccentricity", "or load-dependent-friction"]
    assert name.splitlines() == ["ripple-harmonic", *rivals]
    told = [line.partition(":")[0] for line in parameters.splitlines()]
    assert told == ["amplitude", "phase", "order"]
    assert speaks.splitlines()[:2] == ["explains 31.2 %", "false alarm below 1e-9"]
    assert not any("cosine" in row[1] or "sine" in row[1] for row in table.rows)
    # what has no amplitude keeps its parts
    tacho = result(found, causes=[cause("tacho-ripple", (), order=4.0, cosine=0.1, sine=0.2)])
    assert "cosine: 0.1" in tables(tacho)[0].rows[0][1]


def test_names_that_the_record_cannot_show_fold_by_reason(found):
    table = tables(result(found))[-1]
    assert table.folded
    assert table.title == "What this record can test: 2 of 8 names"
    assert table.rows == (
        ("yes", "spikes, zero-step"),
        ("no: the record has no load_torque_nm", "side-force, backlash, creep"),
        ("no: torque low-passed at 10 Hz", "mains-hum, tooth-mesh"),
        ("no: the record has no motor_current_a", "crosstalk"),
    )


def test_limits_stand_with_the_verdict(found):
    told = verdict(result(found))
    assert told.note == (
        "Left out: 19 289 of 24 841 samples (78 %): the acceleration is not resolved (19 000), "
        "spikes (289).",
        "Rest: 0.119 N·m left in noise of 0.043 N·m: unexplained at velocity.",
    )
    # of many findings the names alone, else no one reads to the end
    assert told.text.endswith(
        "kinematic-error; bearing-defect; ripple-harmonic; unexplained at velocity."
    )
    nothing = {"verdict": "nothing-found", "causes": [], "unexplained": [], "left_out": []}
    quiet = verdict(result(found, **nothing, rest=None))
    assert (quiet.level, quiet.note) == ("good", ())
    # a rest that nothing accounts for is never in order
    rest = {**found["rest"], "told": []}
    assert verdict(result(found, **nothing, rest=rest)).level == "look"


@needs_browser
def test_no_column_is_narrow_and_nothing_is_cut(runs, found, tmp_path):
    pytest.importorskip("websocket")
    run = shutil.copytree(runs["diagnosis"], tmp_path / runs["diagnosis"].name)
    file = run / "result.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **found}))
    report = write_report([run], tmp_path / "report.html").html
    cells = "[...document.querySelectorAll('table.stacked td')]"
    boxes = "[...document.querySelectorAll('.scroll:has(.stacked)')]"
    with browser() as tab:
        for width, scheme in ((1200, "light"), (800, "dark"), (620, "light"), (400, "dark")):
            tab.open(report, width=width, scheme=scheme)
            tab.run("document.querySelector('details').open = true")
            assert tab.run(f"Math.min(...{cells}.map(c => c.clientWidth))") >= 100, width
            assert tab.run(f"{boxes}.every(b => b.scrollWidth <= b.clientWidth)"), width
            if width < 760:
                # as high as it has lines: none is broken
                assert all(abs(high - count) < 0.5 for high, count in tab.run(LINES))
            assert tab.run("document.documentElement.scrollWidth <= window.innerWidth"), width
        assert tab.complaints == []
