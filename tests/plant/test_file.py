"""Plant files: what is read, and how a bad one is named."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from hdbench.errors import ProfileError
from hdbench.plant.plantfile import PlantSpec, draw_effects, list_plants, load_plant

GOOD = """name = "mine"

[[effects]]
kind = "motor-order"
order = 7.9
amplitude_nm = { min = 0.1, max = 0.2 }
phase_rad = 0.0

[[effects]]
kind = "tone"
frequency_hz = { any_of = [50, 60] }
amplitude_nm = 0.1
"""


def _load(tmp_path: Path, text: str) -> PlantSpec:
    file = tmp_path / "mine.toml"
    file.write_text(text, encoding="utf-8")
    return load_plant(str(file))


def _bad(tmp_path: Path, text: str) -> ProfileError:
    with pytest.raises(ProfileError) as caught:
        _load(tmp_path, text)
    return caught.value


def test_the_package_has_its_two_plants():
    assert {"as-modelled", "worn"} <= set(list_plants())
    assert load_plant("as-modelled").data.effects == ()
    assert load_plant("worn").name == "worn"


def test_a_file_of_ones_own_is_read(tmp_path):
    spec = _load(tmp_path, GOOD)
    assert [effect.kind for effect in spec.data.effects] == ["motor-order", "tone"]
    assert spec.sha256 == hashlib.sha256(GOOD.encode()).hexdigest()
    order, tone = draw_effects(spec, np.random.default_rng(0))
    assert order.order == 7.9
    assert tone.frequency_hz in (50.0, 60.0)


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("order = 7.9", "order = -1.0", 5, "not above 0"),
        ("order = 7.9", "order = nan", 5, "finite"),
        ("min = 0.1, max = 0.2", "min = 0.3, max = 0.2", 6, "above max"),
        ("min = 0.1, max = 0.2", "min = 0.3", 6, "both min and max"),
        ("amplitude_nm = 0.1", "amplitude_nm = 0.1\namplitud = 1", 13, "unknown"),
        ("amplitude_nm = 0.1", "", 9, "missing"),
        ('"tone"', '"hum"', 9, "tone"),
        ("any_of = [50, 60]", "any_of = []", 11, "any_of with one"),
        ('name = "mine"', 'name = "mine"\nminimum_effects = 3', 1, "exceeds the 2 effects"),
        ("phase_rad = 0.0", 'phase_rad = "east"', 7, "east"),
    ],
)
def test_a_problem_is_named_with_its_line(tmp_path, old, new, line, says):
    error = _bad(tmp_path, GOOD.replace(old, new))
    assert error.exit_code == 4
    assert error.where.endswith(f"mine.toml:{line}")
    assert says in error.what


def test_an_unknown_key_gets_its_nearest_neighbour(tmp_path):
    error = _bad(tmp_path, GOOD.replace("frequency_hz", "frequenzy_hz"))
    assert "did you mean 'frequency_hz'?" in [problem.fix for problem in error.problems]


def test_every_problem_is_named_at_once_in_the_order_of_the_lines(tmp_path):
    text = GOOD.replace("7.9", "-1").replace("phase_rad = 0.0", "phase = 0.0")
    error = _bad(tmp_path, text)
    lines = [int(problem.where.rpartition(":")[2]) for problem in error.problems]
    assert lines == sorted(lines)
    assert len(lines) == 3


def test_what_is_no_toml_is_named_with_its_line(tmp_path):
    assert ":2" in _bad(tmp_path, "name = 'x'\nname = \n").where


def test_a_name_that_does_not_exist_gets_its_nearest_neighbour():
    with pytest.raises(ProfileError, match="no such plant") as caught:
        load_plant("wron")
    assert "did you mean 'worn'?" in caught.value.fix


def test_a_folder_is_no_plant(tmp_path):
    with pytest.raises(ProfileError, match="not a regular file"):
        load_plant(str(tmp_path))


def test_poles_are_whole_and_a_decay_is_a_share(tmp_path):
    text = GOOD + (
        '[[effects]]\nkind = "cogging"\norder = { any_of = [12, 18] }\namplitude_nm = 0.1\n'
        "phase_rad = 0.0\ndecay = { min = 0.1, max = 0.3 }\n"
    )
    assert _load(tmp_path, text).data.effects[-1].kind == "cogging"
    assert "whole" in _bad(tmp_path, text.replace("[12, 18]", "[12, 18.5]")).what
    assert "whole" in _bad(tmp_path, text.replace("any_of = [12, 18]", "min = 3, max = 5")).what
    assert "[0, 1)" in _bad(tmp_path, text.replace("max = 0.3", "max = 1.0")).what
