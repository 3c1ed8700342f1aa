"""Figures tell the page's script their scales, and a browser zooms them."""

import json
import re
from html import unescape

import numpy as np
import pytest
from browser import browser, browser_program

from hdbench.report.canvas import draw_svg, new_figure


def test_axes_tell_frame_scale_and_labels_and_curves_are_thin():
    time = np.arange(300_000) * 1e-3
    torque = np.zeros(300_000)
    torque[123_456] = 7.0
    figure, (top, bottom) = new_figure(2, 4.0, share_x=True)
    top.curve(time, torque, "measured", label="torque")
    bottom.curve(time, 100.0 + time, "filtered")
    bottom.set_yscale("log")
    bottom.set_ylim(100.0, 1000.0)
    top.axhline(0.0)
    top.label(None, "torque (N·m)")
    bottom.label("time (s)", "velocity (rad/s)")
    svg = draw_svg(figure, "f1", "a peak and a ramp over five minutes, for this test alone")
    found = re.search(r'<metadata class="axes">(.*?)</metadata>', svg, re.DOTALL)
    specs = json.loads(unescape(found[1]))
    assert [spec["group"] for spec in specs] == [0, 0]
    assert [spec["xlabel"] for spec in specs] == ["time (s)", "time (s)"]
    # the zero line over the whole width is no curve
    assert [spec["labels"] for spec in specs] == [["torque"], [""]]
    assert [spec["logy"] for spec in specs] == [False, True]
    assert specs[1]["y"] == pytest.approx([2.0, 3.0])
    curve = re.search(r'id="f1-curve-0-0">\s*<path d="([^"]*)"', svg)
    points = [[float(v) for v in pair.split()] for pair in re.split("[ML]", curve[1]) if pair]
    # two points for each of 4000 stretches; the peak is the top: y counts downwards
    assert len(points) <= 8000
    left, high, width, height = specs[0]["box"]
    x, y = min(points, key=lambda point: point[1])
    share = (specs[0]["x"][1] - specs[0]["x"][0]) / width
    assert specs[0]["x"][0] + share * (x - left) == pytest.approx(123.456, abs=share * 1e-3)
    scale = (specs[0]["y"][1] - specs[0]["y"][0]) / height
    assert specs[0]["y"][1] - scale * (y - high) == pytest.approx(7.0, abs=scale * 1e-3)


# -- in a browser ---------------------------------------------------------------------------------

needs_browser = pytest.mark.skipif(browser_program() is None, reason="no Chromium on this machine")


BOX = """(() => { const s = document.querySelector('#run-3 figure svg');
s.scrollIntoView({block: 'center', behavior: 'instant'});
const r = s.getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; })()"""
SHOWN = "document.querySelector('#run-3 figure .marks text') !== null"
READING = "document.querySelector('#run-3 figure output').textContent"


@needs_browser
def test_a_browser_zooms_reads_and_goes_back(report):
    pytest.importorskip("websocket")
    with browser() as tab:
        for width, scheme in ((1200, "light"), (400, "dark")):
            tab.open(report.html, width=width, scheme=scheme)
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
        assert tab.requests == 2 * [report.html.resolve().as_uri()]
