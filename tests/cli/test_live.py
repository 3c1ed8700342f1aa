"""The live view shows what the frames say, fits the screen, and never holds up a run."""

import io
import itertools
import math
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console
from rich.live import Live

from hdbench.filter import OscillatorBlock
from hdbench.filter.online import BlockAmplitude
from hdbench.profile import load_profile
from hdbench.session.recorder import Frame
from hdbench_cli.live.history import CURVES, History
from hdbench_cli.live.view import LiveView, free_space, picture

PROFILE = load_profile("cim-tr-97-06")
GAIN = PROFILE.data.servo.velocity_gain_rad_s_per_v


def frame(first: int = 0, count: int = 100, *, lost: int = 0, speed: float = 100.0) -> Frame:
    time_s = (first + np.arange(count)) / 1000.0
    columns = {
        "time_s": time_s,
        "motor_velocity_rad_s": np.full(count, speed),
        "reference_v": np.full(count, speed / GAIN),
        "torque_nm": np.sin(200.0 * time_s),
        "torque_filtered_online_nm": np.zeros(count),
        "motor_current_a": np.full(count, 0.5),
    }
    amplitudes = (
        BlockAmplitude(OscillatorBlock(2.0, "ripple", 1.0), 0.8, 0.1),
        BlockAmplitude(OscillatorBlock(0.01, "misalignment", 1.0), 0.4, 0.1),
    )
    done = (first + count) / 1000.0
    return Frame("run", done, 10.0, columns, first + count, lost, 0, 3, 0, amplitudes)


def history(frames: list[Frame], seconds_each: float = 0.1) -> History:
    now = [0.0]
    found = History(GAIN, clock=lambda: now[0])
    for one in frames:
        now[0] += seconds_each
        found.add([one])
    return found


def drawn(found: History, width: int) -> list[str]:
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(picture(found, PROFILE, ("ripple on bench: run", "12 GB"), width))
    return console.export_text().splitlines()


def test_rate_and_time_left_follow_the_wall_clock():
    # 100 samples of 1 ms each in 0.2 s of wall time: half pace
    found = history([frame(100 * k) for k in range(20)], 0.2)
    assert found.rate_hz() == pytest.approx(500.0)
    assert found.eta_s() == pytest.approx((10.0 - 2.0) * 2.0)


def test_before_the_second_frame_neither_is_known():
    found = history([frame()])
    assert math.isnan(found.rate_hz())
    assert math.isnan(found.eta_s())


def test_a_curve_holds_the_means_of_its_span_and_nan_before_it():
    found = history([frame(100 * k, speed=float(k)) for k in range(10)])
    (velocity,) = [curve for curve in CURVES if curve.label == "velocity"]
    # 20 s in 200 parts of 0.1 s: the last ten hold one frame each
    curve = found.curve(velocity, 200)
    assert np.isnan(curve[:189]).all()
    # one sample of a hundred at a joint may fall on either side of it: 0.01 of the step of 1
    np.testing.assert_allclose(curve[-9:], np.arange(1.0, 10.0), atol=0.02)
    command = found.curve(next(c for c in CURVES if c.label == "command"), 200)
    np.testing.assert_allclose(command[-9:], curve[-9:])


def test_only_the_last_seconds_are_kept():
    found = history([frame(1000 * k, 1000) for k in range(100)])
    assert len(found.columns["time_s"]) <= 45_000


@pytest.mark.parametrize("width", [40, 80, 132])
def test_the_picture_fits_the_screen_breaks_no_line_and_tells_the_numbers(width):
    found = history([frame(100 * k, lost=7) for k in range(30)])
    lines = drawn(found, width)
    assert len(lines) <= 23
    assert max(map(len, lines)) <= width
    counts = ("samples/s", "lost 7", "saturated", "retries", "waiting", "disk 12 GB")
    for word in (*counts, "100.000 rad/s", "order 2", "output", "0.800"):
        assert any(word in line for line in lines), word
    # a line that was broken would leave its end on a line of its own
    assert not any(line.strip() in ("limit", "%", "% limit") for line in lines)
    share = "%" if width == 40 else "% limit"
    assert any(line.startswith("velocity") and line.rstrip().endswith(share) for line in lines)


def test_curves_are_drawn_in_blocks_while_a_display_stands_for_stderr(monkeypatch):
    class Terminal(io.StringIO):
        encoding = "utf-8"

        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setattr(sys, "stderr", terminal)
    found = history([frame(100 * k, speed=float(k)) for k in range(30)])
    words = ("ripple on bench: run", "12 GB")
    with Live(console=Console(stderr=True, width=80), auto_refresh=False) as live:
        live.update(picture(found, PROFILE, words, 80), refresh=True)
        assert sys.stderr is not terminal
    assert "▇" in terminal.getvalue()


def test_a_speed_above_its_limit_is_told_in_per_cent():
    speed = 1.25 * PROFILE.data.limits.velocity_rad_s
    assert any("125 % limit" in line for line in drawn(history([frame(speed=speed)]), 80))


def test_what_is_lost_is_no_number_in_the_picture():
    bad = frame()
    bad.columns["torque_nm"][:] = math.nan
    assert not any("nan" in line.lower() for line in drawn(history([bad]), 80))


def test_a_view_whose_screen_hangs_takes_no_time_of_the_run(tmp_path, monkeypatch):
    drawing, stuck = threading.Event(), threading.Event()
    view = LiveView("ripple", PROFILE, tmp_path, pretty=True)
    monkeypatch.setattr(LiveView, "_draw", lambda _self: drawing.set() or stuck.wait())
    view.start()
    view.frame(frame())
    assert drawing.wait(60.0)
    frames = [frame(100 * k, 10) for k in range(1000)]
    run = threading.Thread(target=lambda: list(map(view.frame, frames)), daemon=True)
    run.start()
    run.join(60.0)
    waits = run.is_alive()
    stuck.set()
    view.stop()
    assert not waits
    assert [f.rows for f in view.queue] == [100 * k + 10 for k in range(936, 1000)]


def test_without_a_terminal_a_line_is_told_every_few_seconds(tmp_path, capsys):
    clock = itertools.count(0.0, 6.0).__next__
    view = LiveView("ripple", PROFILE, tmp_path, pretty=False, clock=clock)
    ends = iter([False, True])
    view._stop = SimpleNamespace(wait=lambda _seconds: next(ends))
    view.frame(frame(lost=7))
    view._run()
    told = capsys.readouterr().err
    assert told.startswith("ripple: 0 of 10 s; 100 samples, 7 lost, 0 saturated, 0 retries; ")


def test_space_left_is_told_for_a_folder_that_is_not_there_yet(tmp_path):
    assert free_space(tmp_path / "runs" / "later").split()[1] in {"kB", "MB", "GB", "TB"}
