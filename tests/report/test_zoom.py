"""Figures keep every sample for the reader who zooms, and a browser shows it."""

from __future__ import annotations

import base64
import json
import re
import sys
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdbench.report.canvas import draw_svg, label_axes, new_figure, trend

sys.path.insert(0, str(Path(__file__).parent))
from browser import browser, browser_program

RATE_HZ = 1000.0


def figure(n: int = 5000, *, gap: bool = False) -> str:
    time = np.arange(n) / RATE_HZ
    torque = np.sin(2.0 * np.pi * 50.0 * time)
    if gap:
        torque[100:200] = np.nan
    drawn, axes = new_figure(2, 4.0, share_x=True)
    trend(axes[0], time, torque, "measured", label="torque")
    trend(axes[1], time, 100.0 + time, "filtered")
    axes[0].axhline(0.0)
    label_axes(axes[0], None, "torque (N·m)")
    label_axes(axes[1], "time (s)", "velocity (rad/s)")
    return draw_svg(drawn, "f1", "a sine and a ramp over five seconds, for this test alone")


def described(svg: str) -> dict[str, Any]:
    found = re.search(r'<metadata class="curves">(.*?)</metadata>', svg, re.DOTALL)
    assert found is not None
    return dict(json.loads(unescape(found[1])))


def test_every_sample_of_a_long_curve_goes_along() -> None:
    axes = described(figure())["axes"]
    line = axes[0]["lines"][0]
    assert line["xs"] == pytest.approx({"start": 0.0, "step": 1e-3, "n": 5000})
    values = np.frombuffer(base64.b64decode(line["ys"]["data"]), "<f4")
    expected = np.sin(2.0 * np.pi * 50.0 * np.arange(5000) / RATE_HZ)
    # float32 holds 24 bits
    np.testing.assert_allclose(values, expected, atol=1e-7)
    assert not line["thinned"]


def test_what_is_drawn_still_is_thin() -> None:
    paths = re.findall(r' d="([^"]*)"', figure(60_000))
    # 600 stretches with two or three points each
    assert max(len(re.findall(r"[ML]", path)) for path in paths) <= 1800


def test_axes_that_share_their_abscissa_are_one_group_and_bear_its_name() -> None:
    axes = described(figure())["axes"]
    assert [one["group"] for one in axes] == [0, 0]
    assert [one["xlabel"] for one in axes] == ["time (s)", "time (s)"]
    assert axes[0]["moved"], "the zero line moves along"


def test_a_curve_too_long_for_the_page_keeps_its_peaks_and_says_so() -> None:
    time = np.arange(300_000) / RATE_HZ
    torque = np.zeros(300_000)
    torque[123_456] = 7.0
    drawn, axes = new_figure(1, 3.0)
    trend(axes[0], time, torque, "measured")
    line = described(draw_svg(drawn, "f2", "zero with one peak of seven, for this test"))["axes"][
        0
    ]["lines"][0]
    values = np.frombuffer(base64.b64decode(line["ys"]["data"]), "<f4")
    assert line["thinned"]
    assert len(values) <= 65_536
    assert values.max() == 7.0


# -- in a browser ---------------------------------------------------------------------------------

needs_browser = pytest.mark.skipif(browser_program() is None, reason="no Chromium on this machine")


@pytest.fixture(scope="module")
def report(runs: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    from hdbench.report import write_report

    kinds = ("calibration", "misalignment", "ripple", "diagnosis")
    out = tmp_path_factory.mktemp("zoom") / "all.html"
    return write_report([runs[kind] for kind in kinds], out).html


BOX = """(() => { const s = document.querySelector('#run-3 figure svg');
s.scrollIntoView({block: 'center', behavior: 'instant'});
const r = s.getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; })()"""
SHOWN = "document.querySelector('#run-3 figure .zoomed path') !== null"
READING = "document.querySelector('#run-3 figure output').textContent"


@needs_browser
@pytest.mark.parametrize(("width", "scheme"), [(1200, "light"), (400, "dark")])
def test_a_browser_zooms_reads_and_goes_back(report: Path, width: int, scheme: str) -> None:
    pytest.importorskip("websocket")
    with browser() as tab:
        tab.open(report, width=width, scheme=scheme)
        assert tab.run("document.querySelectorAll('figure svg path').length") > 20
        assert not tab.run(SHOWN)
        x, y, w, h = tab.run(BOX)
        at = y + 0.12 * h
        tab.drag((x + 0.3 * w, at), (x + 0.5 * w, at))
        assert tab.run(SHOWN)
        tab.mouse("mouseMoved", x + 0.5 * w, at)
        told = re.fullmatch(r"time \(s\) (\S+): torque \(N·m\) (\S+)", tab.run(READING))
        assert told is not None, tab.run(READING)
        tab.run("document.querySelector('#run-3 figure [aria-label*=whole]').click()")
        assert not tab.run(SHOWN)
        tab.run("document.querySelector('#run-3 figure svg').focus()")
        tab.call("Input.dispatchKeyEvent", type="keyDown", key="+", text="+")
        assert tab.run(SHOWN)
        # nothing sticks out of a narrow page
        assert tab.run("document.documentElement.scrollWidth <= window.innerWidth")
        assert tab.complaints == []
        assert tab.requests == [report.resolve().as_uri()]
