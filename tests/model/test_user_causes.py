"""Causes of a user's own: files, model files, installed packages."""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hdbench.errors import DataError
from hdbench.model import (
    BenchModel,
    Cause,
    CauseTerm,
    Motion,
    catalogue,
    cause_named,
    describe_causes,
    load_causes,
    load_model,
    save_model,
    user_causes,
)
from hdbench.model.cause import plugin_causes

EXAMPLE = (Path(__file__).parents[2] / "docs" / "causes.md").read_text(encoding="utf-8")


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def one(tmp_path: Path, text: str) -> Cause:
    (cause,) = load_causes(written(tmp_path / "own.toml", '[[cause]]\nname = "own"\n' + text))
    return cause


def tone_named(name: str) -> str:
    return f'[[cause]]\nname = "{name}"\nkind = "tone"\nfrequencies_hz = [3]\n'


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
def test_fixed_orders_are_sines_of_the_angle(growth, tmp_path, make_motion):
    text = f'kind = "harmonics"\nof = "output"\norders = [3, 7.5]\ngrows_with = "{growth}"'
    cause, motion = one(tmp_path, text), make_motion()
    o, size = motion.output_angle_rad, GROWTH[growth](motion)
    waves = [np.cos(3 * o), np.sin(3 * o), np.cos(7.5 * o), np.sin(7.5 * o)]
    by_hand(cause, motion, {}, np.column_stack([size * wave for wave in waves]))
    assert cause.locked_to == "output"
    assert not cause.harmonic


def test_an_order_that_is_fitted_brings_its_harmonics(tmp_path, make_motion):
    text = 'kind = "harmonics"\nof = "motor"\norder_range = [3.2, 3.6]\nmultiples = [1, 3]'
    cause, motion = one(tmp_path, text), make_motion()
    a = 3.4 * motion.angle_rad
    want = np.column_stack([np.cos(a), np.sin(a), np.cos(3 * a), np.sin(3 * a)])
    by_hand(cause, motion, {"order": 3.4}, want)
    assert (cause.shape[0].lower, cause.shape[0].upper) == (3.2, 3.6)


def test_a_tone_is_a_sine_over_time(tmp_path, make_motion):
    fixed = one(tmp_path, 'kind = "tone"\nfrequencies_hz = [37.0]')
    free = one(tmp_path, 'kind = "tone"\nfrequency_range_hz = [30, 45]')
    motion = make_motion()
    phase = 2 * math.pi * 37.0 * motion.time_s
    want = np.column_stack([np.cos(phase), np.sin(phase)])
    by_hand(fixed, motion, {}, want)
    by_hand(free, motion, {"frequency_hz": 37.0}, want)
    assert fixed.harmonic


@pytest.mark.parametrize(
    ("over", "variable"),
    [
        ("velocity", lambda m: m.velocity_rad_s),
        ("load", lambda m: m.load_torque_nm + 1.725e-4 * m.acceleration_rad_s2),
        ("time", lambda m: m.time_s - m.time_s[0]),
        ("temperature", lambda m: m.temperature_c - m.temperature_c[0]),
    ],
)
def test_a_polynomial_has_one_column_for_each_power(over, variable, tmp_path, make_motion):
    text = f'kind = "polynomial"\nover = "{over}"\npowers = [1, 3]\nscale = 20'
    cause, motion = one(tmp_path, text), make_motion()
    x = variable(motion) / 20
    by_hand(cause, motion, {}, np.column_stack([x, x * x * x]))
    assert [p.name for p in cause.linear] == ["power_1_nm", "power_3_nm"]


def test_a_table_is_joined_by_straight_lines_round_the_turn(tmp_path, make_motion):
    text = 'kind = "table"\nof = "motor"\nangle_rad = [1, 2, 4]\ntorque_nm = [0, 1, -0.5]'
    cause = one(tmp_path, text)
    gap = 2 * math.pi - 3
    angle = np.array([1.5, 3.0, 4.0, 4.0 + gap / 2, 0.0, 1.5 + 20 * math.pi, 1.5 - 2 * math.pi])
    want = [0.5, 0.25, -0.5, -0.25, -0.5 / gap, 0.5, 0.5]
    motion = make_motion(7, angle_rad=angle)
    # angles of ten turns: doubles 7e-15 apart
    np.testing.assert_allclose(cause.columns(motion, {})[:, 0], want, rtol=0, atol=2e-14)


def test_a_record_without_temperature_says_so(tmp_path, make_motion):
    cause = one(tmp_path, 'kind = "polynomial"\nover = "temperature"\npowers = [1]')
    assert "no temperature_c" in str(cause.applicable(make_motion(temperature_c=None)))
    term = CauseTerm("own", {}, (0.1,))
    model = BenchModel(0.0, 0.0, (), (0.0, 0.0)).with_extra([cause]).with_cause(term)
    with pytest.raises(DataError, match="needs temperature_c"):
        model.torque_nm(make_motion(temperature_c=None))


TABLE = 'kind = "table"\nof = "motor"\n'
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
    (TABLE + "angle_rad = [2, 1]\ntorque_nm = [0, 1]", ":1", "does not increase", ""),
    (TABLE + "angle_rad = [1, 2]\ntorque_nm = [0, 1, 2]", ":1", "2 angles and 3 torques", ""),
    ('kind = "tone"\nfrequencies_hz = [3]\nlook_alikes = ["ripple"]', ":5", "'ripple'", "ripple-"),
]


@pytest.mark.parametrize(("text", "line", "what", "fix"), BAD, ids=[b[2] + b[3] for b in BAD])
def test_a_wrong_entry_is_told_by_line_and_need(text, line, what, fix, tmp_path):
    path = tmp_path / "own.toml"
    with pytest.raises(DataError) as caught:
        one(tmp_path, text)
    assert caught.value.where == f"{path}{line}"
    assert what in caught.value.what
    assert fix in caught.value.fix


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "missing"),
        ("cause = []", "holds no cause"),
        ("cause = 3", "found 3"),
        ("[[cause", "not TOML"),
        (tone_named("Own"), "found 'Own'"),
        (tone_named("backlash"), "'backlash' is a name of the catalogue"),
        (tone_named("x") * 2, "'x' is a name of a cause above it"),
    ],
)
def test_a_wrong_file_is_told(text, what, tmp_path):
    with pytest.raises(DataError) as caught:
        load_causes(written(tmp_path / "own.toml", text))
    assert what in caught.value.what
    with pytest.raises(DataError):
        load_causes(tmp_path / "none.toml")


def test_every_problem_of_a_file_is_told_at_once(tmp_path):
    text = '[[cause]]\nname = "a"\nkind = "tone"\nhz = 1\n[[cause]]\nname = "B"\nkind = "tone"\n'
    with pytest.raises(DataError, match="2 problems") as caught:
        load_causes(written(tmp_path / "own.toml", text))
    assert [p.where.rpartition(":")[2] for p in caught.value.problems] == ["4", "6"]


def test_several_files_may_not_share_a_name(tmp_path):
    first, second = (written(tmp_path / f"{n}.toml", tone_named("own")) for n in "ab")
    assert [c.name for c in user_causes([first])] == ["own"]
    assert user_causes([]) == ()
    with pytest.raises(DataError, match=r"stands in .*a\.toml too"):
        user_causes([first, second])


def test_a_model_file_carries_declared_causes(tmp_path, profile, make_motion):
    toml = written(tmp_path / "own.toml", EXAMPLE.split("```toml\n")[1].split("```")[0])
    causes = user_causes([toml])
    assert len(causes) >= 4
    model = BenchModel.from_profile(profile.data).with_extra(causes)
    for cause in causes:
        shape = {p.name: 0.5 * (p.lower + p.upper) for p in cause.shape}
        model = model.with_cause(CauseTerm(cause.name, shape, (0.1,) * len(cause.linear)))
    path = tmp_path / "model.json"
    save_model(path, model, profile=profile, provenance={})
    toml.unlink()
    found = load_model(path)
    motion = make_motion()
    assert found.torque_nm(motion).tobytes() == model.torque_nm(motion).tobytes()
    assert [c.definition for c in found.extra_causes] == [c.definition for c in causes]
    again = tmp_path / "again.json"
    save_model(again, found, profile=profile, provenance={})
    assert again.read_bytes() == path.read_bytes()
    body = json.loads(path.read_text())
    for key, value, words in (("name", "other", "unknown cause"), ("kind", "tonne", "'tonne'")):
        body["definitions"][0][key] = value
        path.write_text(json.dumps(body))
        with pytest.raises(DataError, match=words) as caught:
            load_model(path)
    assert caught.value.where == f"{path}: key definitions.0"


def test_a_declaration_that_is_not_used_stays_out_of_the_file(tmp_path, profile):
    cause = one(tmp_path, 'kind = "tone"\nfrequencies_hz = [3]')
    model = BenchModel.from_profile(profile.data).with_extra([cause])
    save_model(tmp_path / "m.json", model, profile=profile, provenance={})
    assert json.loads((tmp_path / "m.json").read_text())["definitions"] == []


def test_two_causes_of_one_name_never_share_a_model(tmp_path, profile):
    first = one(tmp_path, 'kind = "tone"\nfrequencies_hz = [3]')
    other = one(tmp_path, 'kind = "tone"\nfrequencies_hz = [4]')
    model = BenchModel.from_profile(profile.data).with_extra([first, first])
    assert model.extra_causes == (first,)
    with pytest.raises(DataError, match="two causes have the name 'own'"):
        model.with_extra([other])


def entry_of(thing: object, name: str) -> SimpleNamespace:
    """Return an entry point that gives what it is told to."""

    def load() -> object:
        if isinstance(thing, Exception):
            raise thing
        return thing

    package = SimpleNamespace(name="bench-extras")
    return SimpleNamespace(name=name, value="extras:causes", dist=package, load=load)


def renamed(name: str) -> Cause:
    return replace(catalogue()["viscous-friction"], name=name)


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    def install(*things: object) -> None:
        plugin_causes.cache_clear()
        entries = [entry_of(thing, f"e{k}") for k, thing in enumerate(things)]
        monkeypatch.setattr("hdbench.model.cause.entry_points", lambda group: entries)

    yield install
    plugin_causes.cache_clear()


def test_an_installed_package_brings_causes(installed):
    a, b, c, d = (renamed(f"own-{k}") for k in "abcd")
    installed(a, [b], lambda: (c, d))
    assert list(catalogue())[48:] == ["own-a", "own-b", "own-c", "own-d"]
    assert cause_named("own-c", where="here") is c
    described = describe_causes()
    assert [entry["group"] for entry in described[47:]] == ["acquisition", *["user's own"] * 4]


@pytest.mark.parametrize(
    ("thing", "words"),
    [
        (ImportError("no module named x"), "ImportError: no module named x"),
        (lambda: 1 / 0, "ZeroDivisionError"),
        (7, "gives int; needed: hdbench.model.Cause"),
        ([renamed("own"), "x"], "gives str"),
        ([renamed("own"), renamed("own")], "'own', a name that is taken"),
        (renamed("backlash"), "'backlash', a name that is taken"),
    ],
)
def test_a_broken_package_is_named(thing, words, installed):
    installed(thing)
    with pytest.raises(DataError) as caught:
        catalogue()
    assert words in caught.value.what
    assert "'bench-extras'" in caught.value.what
    assert caught.value.where == "entry point e0 = extras:causes of group hdbench.causes"
    # models that do not need it go on
    assert cause_named("backlash", where="here").name == "backlash"


def test_the_list_of_causes_is_plain_data_in_the_contracts_order():
    described = json.loads(json.dumps(describe_causes(), allow_nan=False))
    assert [entry["name"] for entry in described] == list(catalogue())
    for entry, cause in zip(described, catalogue().values(), strict=True):
        kinds = [p["kind"] for p in entry["parameters"]]
        assert kinds == ["shape"] * len(cause.shape) + ["linear"] * len(cause.linear)
        assert all(p["unit"] and p["lower"] < p["upper"] for p in entry["parameters"])
        assert entry["additive"] is cause.additive
        assert entry["group"] != "user's own"
