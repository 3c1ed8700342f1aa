"""Questions and lines of a calibration in words."""

from __future__ import annotations

import math

from hdbench.session.calibrating.conversation import Answer, LiveReading, Question
from hdbench.session.calibrating.plausibility import Expectation
from hdbench.session.calibrating.points import Point
from hdbench.session.calibrating.settling import Judgement, SettledReading, SettleRule
from hdbench.session.calibrating.state import CalibrationState

_ALL = (Answer.ACCEPT, Answer.REPEAT, Answer.BACK, Answer.SKIP, Answer.QUIT)


def lock_question() -> Question:
    """Ask for the locked wave generator."""
    return Question(
        "lock",
        "Lock the wave generator with the locking shaft and mount the arm.",
        (Answer.ACCEPT, Answer.QUIT),
    )


def place_question(point: Point) -> Question:
    """Ask for the flexspline position of a point."""
    degrees = math.degrees(point.position_rad)
    return Question(
        "place",
        f"Weights off. Bring the flexspline to position {point.position_index} of "
        f"{point.position_count}: {degrees:.1f} degrees, and lock again.",
        (Answer.ACCEPT, Answer.QUIT),
    )


def hang_question(point: Point, expectation: Expectation) -> Question:
    """Ask for a weight."""
    if point.role == "shunt":
        what = "Switch the shunt resistor on."
    elif point.mass_kg == 0.0:
        what = f"Take all weights off ({point.direction} side)."
    else:
        what = f"Hang {point.mass_kg:g} kg on the {point.direction} side."
    expected = ""
    if point.role in ("reading", "preload"):
        volts = expectation.volts(point.torque_nm)
        expected = f" Expect {point.torque_nm:+.3f} N m, {volts:+.3f} V."
    return Question("hang", f"{point.label}: {what}{expected}", _ALL)


def still_question(point: Point, waited_s: float, spread_nm: float) -> Question:
    """Ask what to do with a reading that does not settle."""
    return Question(
        "time-out",
        f"{point.label}: not steady after {waited_s:.0f} s (the reading moves by "
        f"{spread_nm:.3f} N m). Take its average as it is, marked?",
        _ALL,
    )


def wrong_question(point: Point, problem: str) -> Question:
    """Ask what to do with a reading that does not fit its weight."""
    wanted = "no weight" if point.mass_kg == 0.0 else f"{point.mass_kg:g} kg"
    wanted = "the shunt resistor on" if point.role == "shunt" else wanted
    text = f"{problem} Asked for: {wanted}, {point.direction} side."
    return Question("gross-error", text, _ALL, default=Answer.REPEAT)


def last_question(taken: int, skipped: int) -> Question:
    """Ask whether everything is done."""
    left = f", {skipped} skipped" if skipped else ""
    return Question(
        "last",
        f"{taken} readings taken{left}. Finish the calibration?",
        (Answer.ACCEPT, Answer.REPEAT, Answer.BACK, Answer.QUIT),
    )


def left_line(state: CalibrationState) -> str:
    """Say how an earlier session left the bench."""
    hangs = "no weight" if state.hanging is None else state.points[state.hanging - 1].describe()
    return (
        f"goes on after {len(state.standing)} readings. The bench was left locked, flexspline at "
        f"{math.degrees(state.position_rad or 0.0):.1f} degrees; last on the arm: {hangs}. "
        "If that has changed, restore it."
    )


def accepted_line(
    point: Point, reading: SettledReading, expectation: Expectation, flags: list[str]
) -> str:
    """Say what was accepted."""
    swing = f", {reading.swing.period_s:.2f} s swing averaged" if reading.swing else ""
    marked = f", marked {'; '.join(flags)}" if flags else ""
    return (
        f"accepted {point.label}: {reading.mean_v:+.4f} V, "
        f"{expectation.torque_nm(reading.mean_v):+.3f} N m{swing}{marked}"
    )


def live_reading(
    point: Point, judged: Judgement, rule: SettleRule, waited_s: float, torque_nm: float
) -> LiveReading:
    """Return what a person sees of one moment."""
    needed_s = rule.window * rule.period_s
    earliest_s = rule.read_after * rule.period_s + needed_s
    return LiveReading(
        label=point.label,
        value_v=judged.value_v,
        slope_v_s=judged.slope_v_s,
        spread_v=judged.spread_v,
        torque_nm=torque_nm,
        share=judged.share,
        remaining_s=max((1.0 - judged.share) * needed_s, earliest_s - waited_s),
        waited_s=waited_s,
        limit_s=rule.limit * rule.period_s,
        swing_period_s=None if judged.swing is None else judged.swing.period_s,
    )
