from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdbench.errors import DataError
from hdbench.model import (
    BenchModel,
    Cause,
    CauseTerm,
    Motion,
    load_causes,
)

Make = Callable[..., Motion]
EXAMPLE = (Path(__file__).parents[2] / "docs" / "causes.md").read_text(encoding="utf-8")


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def one(tmp_path: Path, text: str) -> Cause:
    (cause,) = load_causes(written(tmp_path / "own.toml", '[[cause]]\nname = "own"\n' + text))
    return cause


def by_hand(cause: Cause, motion: Motion, shape: dict[str, float], want: np.ndarray) -> None:
    got = cause.columns(motion, shape)
    assert got.shape == (len(motion), len(cause.linear))
    # angles of 2000 rad times orders of 10: doubles 4e-12 apart
    np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-11)


GROWTH: dict[str, Callable[[Motion], Any]] = {
    "nothing": lambda m: 1.0,
    "speed": lambda m: abs(m.velocity_rad_s) / 100,
    "speed-squared": lambda m: m.velocity_rad_s**2 / 1e4,
    "load": lambda m: (m.load_torque_nm + 1.725e-4 * m.acceleration_rad_s2) / 10,
    "load-magnitude": lambda m: abs(m.load_torque_nm + 1.725e-4 * m.acceleration_rad_s2) / 10,
}


@pytest.mark.parametrize("growth", GROWTH)
def test_fixed_orders_are_sines_of_the_angle(
    growth: str, tmp_path: Path, make_motion: Make
) -> None:
    text = f'kind = "harmonics"\nof = "output"\norders = [3, 7.5]\ngrows_with = "{growth}"'
    cause, motion = one(tmp_path, text), make_motion()
    o, size = motion.output_angle_rad, GROWTH[growth](motion)
    waves = [np.cos(3 * o), np.sin(3 * o), np.cos(7.5 * o), np.sin(7.5 * o)]
    by_hand(cause, motion, {}, np.column_stack([size * wave for wave in waves]))
    assert cause.locked_to == "output"
    assert not cause.harmonic


def test_an_order_that_is_fitted_brings_its_harmonics(tmp_path: Path, make_motion: Make) -> None:
    text = 'kind = "harmonics"\nof = "motor"\norder_range = [3.2, 3.6]\nmultiples = [1, 3]'
    cause, motion = one(tmp_path, text), make_motion()
    a = 3.4 * motion.angle_rad
    want = np.column_stack([np.cos(a), np.sin(a), np.cos(3 * a), np.sin(3 * a)])
    by_hand(cause, motion, {"order": 3.4}, want)
    assert (cause.shape[0].lower, cause.shape[0].upper) == (3.2, 3.6)


def test_a_tone_is_a_sine_over_time(tmp_path: Path, make_motion: Make) -> None:
    fixed = one(tmp_path, 'kind = "tone"\nfrequencies_hz = [37.0]')
    motion = make_motion()
    phase = 2 * math.pi * 37.0 * motion.time_s
    by_hand(fixed, motion, {}, np.column_stack([np.cos(phase), np.sin(phase)]))
    assert fixed.harmonic
    free = one(tmp_path, 'kind = "tone"\nfrequency_range_hz = [30, 45]')
    want = np.column_stack([np.cos(phase), np.sin(phase)])
    by_hand(free, motion, {"frequency_hz": 37.0}, want)


@pytest.mark.parametrize(
    ("over", "variable"),
    [
        ("velocity", lambda m: m.velocity_rad_s),
        ("load", lambda m: m.load_torque_nm + 1.725e-4 * m.acceleration_rad_s2),
        ("time", lambda m: m.time_s - m.time_s[0]),
        ("temperature", lambda m: m.temperature_c - m.temperature_c[0]),
    ],
)
def test_a_polynomial_has_one_column_for_each_power(
    over: str, variable: Callable[[Motion], Any], tmp_path: Path, make_motion: Make
) -> None:
    text = f'kind = "polynomial"\nover = "{over}"\npowers = [1, 3]\nscale = 20'
    cause, motion = one(tmp_path, text), make_motion()
    x = variable(motion) / 20
    by_hand(cause, motion, {}, np.column_stack([x, x * x * x]))
    assert [p.name for p in cause.linear] == ["power_1_nm", "power_3_nm"]


def test_a_table_is_joined_by_straight_lines_round_the_turn(
    tmp_path: Path, make_motion: Make
) -> None:
    text = 'kind = "table"\nof = "motor"\nangle_rad = [1, 2, 4]\ntorque_nm = [0, 1, -0.5]'
    cause = one(tmp_path, text)
    gap = 2 * math.pi - 3
    angle = np.array([1.5, 3.0, 4.0, 4.0 + gap / 2, 0.0, 1.5 + 20 * math.pi, 1.5 - 2 * math.pi])
    want = [0.5, 0.25, -0.5, -0.25, -0.5 / gap, 0.5, 0.5]
    motion = make_motion(7, angle_rad=angle)
    # angles of ten turns: doubles 7e-15 apart
    np.testing.assert_allclose(cause.columns(motion, {})[:, 0], want, rtol=0, atol=2e-14)


def test_a_record_without_temperature_says_so(tmp_path: Path, make_motion: Make) -> None:
    cause = one(tmp_path, 'kind = "polynomial"\nover = "temperature"\npowers = [1]')
    assert "no temperature_c" in str(cause.applicable(make_motion(temperature_c=None)))
    term = CauseTerm("own", {}, (0.1,))
    model = BenchModel(0.0, 0.0, (), (0.0, 0.0)).with_extra([cause]).with_cause(term)
    with pytest.raises(DataError, match="needs temperature_c"):
        model.torque_nm(make_motion(temperature_c=None))


BAD = [
    ('kind = "tone"\nfrequency_hz = 3', ":4", "unknown", "frequencies_hz"),
    ('kind = "tone"', ":1", "either frequencies_hz or frequency_range_hz", ""),
    ('kind = "tone"\nfrequencies_hz = [0]', ":4", "greater than 0", ""),
    ('kind = "tone"\nfrequencies_hz = [nan]', ":4", "found nan", ""),
    ('kind = "tone"\nfrequency_range_hz = [5, 4]', ":4", "5 is not below 4", ""),
    ('kind = "tonne"\n', ":3", "found 'tonne'; needed: one of harmonics, tone", ""),
    ("orders = [2]", ":1", "missing", "kind"),
    ('kind = "harmonics"\norders = [2]', ":1", "missing", "add of"),
    ('kind = "harmonics"\nof = "belt"\norders = [2]', ":4", "found 'belt'", ""),
    ('kind = "harmonics"\nof = "motor"\norders = [2, 2]', ":5", "a value twice", ""),
    ('kind = "polynomial"\nover = "load"\npowers = [0]', ":5", "found 0", ""),
    (
        'kind = "table"\nof = "motor"\nangle_rad = [2, 1]\ntorque_nm = [0, 1]',
        ":1",
        "does not increase",
        "",
    ),
    (
        'kind = "table"\nof = "motor"\nangle_rad = [1, 2]\ntorque_nm = [0, 1, 2]',
        ":1",
        "2 angles and 3 torques",
        "",
    ),
    ('kind = "tone"\nfrequencies_hz = [3]\nlook_alikes = ["ripple"]', ":5", "'ripple'", "ripple-"),
]


@pytest.mark.parametrize(("text", "line", "what", "fix"), BAD, ids=[b[2] + b[3] for b in BAD])
def test_a_wrong_entry_is_told_by_line_and_need(
    text: str, line: str, what: str, fix: str, tmp_path: Path
) -> None:
    path = tmp_path / "own.toml"
    with pytest.raises(DataError) as caught:
        one(tmp_path, text)
    assert caught.value.where == f"{path}{line}"
    assert what in caught.value.what
    assert fix in caught.value.fix
    assert caught.value.exit_code == 4


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "missing"),
        ("cause = []", "holds no cause"),
        ("cause = 3", "found 3"),
        ("[[cause", "not TOML"),
        ('[[cause]]\nname = "Own"\nkind = "tone"\nfrequencies_hz = [3]', "found 'Own'"),
        (
            '[[cause]]\nname = "backlash"\nkind = "tone"\nfrequencies_hz = [3]',
            "'backlash' is a name of the catalogue",
        ),
        (
            '[[cause]]\nname = "x"\nkind = "tone"\nfrequencies_hz = [3]\n' * 2,
            "'x' is a name of a cause above it",
        ),
    ],
)
def test_a_wrong_file_is_told(text: str, what: str, tmp_path: Path) -> None:
    with pytest.raises(DataError) as caught:
        load_causes(written(tmp_path / "own.toml", text))
    assert what in caught.value.what
    with pytest.raises(DataError):
        load_causes(tmp_path / "none.toml")


def test_every_problem_of_a_file_is_told_at_once(tmp_path: Path) -> None:
    text = '[[cause]]\nname = "a"\nkind = "tone"\nhz = 1\n[[cause]]\nname = "B"\nkind = "tone"\n'
    with pytest.raises(DataError, match="2 problems") as caught:
        load_causes(written(tmp_path / "own.toml", text))
    assert [p.where.rpartition(":")[2] for p in caught.value.problems] == ["4", "6"]
