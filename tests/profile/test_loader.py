"""A good profile loads; a bad one names every error with its place."""

import hashlib
import itertools
import tomllib
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hdbench.errors import ProfileError
from hdbench.profile import (
    check_loads,
    check_profiles,
    list_profiles,
    load_profile,
    new_profile,
    parse_profile,
    profile_schema,
)
from hdbench.session.experiments import make_plan

NAME = "cim-tr-97-06"


@pytest.fixture(scope="module")
def good():
    return load_profile(NAME)


def problems(text):
    with pytest.raises(ProfileError) as caught:
        parse_profile(text, "bench.toml")
    return caught.value.problems


def line_of(text, start):
    return next(i for i, line in enumerate(text.splitlines(), 1) if line.startswith(start))


def test_the_built_in_profile_holds_the_numbers_of_the_report(good):
    data = good.data
    # report, section 2, section 3 with table 1, section 4, listings A.1 and A.2
    assert (data.drive.gear_ratio, data.drive.rated_torque_nm) == (100.0, 40.0)
    assert data.drive.load_inertia_kg_m2 == 1.725e-2
    assert (data.drive.flexspline_diameter_mm, data.drive.flexspline_length_mm) == (46.0, 49.0)
    assert (data.sensor.gain_nm_per_v, data.sensor.gain_consistency) == (6.6, 0.02)
    assert (data.sensor.excitation_v, data.sensor.amplifier_gain) == (10.0, 1000.0)
    assert data.tacho.gain_rad_s_per_v == 56.2565
    assert data.daq.sample_period_s == 0.001
    assert data.filter.differentiator_time_constant_s == 0.005
    assert (data.filter.ripple_process_noise, data.filter.measurement_noise) == (1000.0, 1.0)
    assert data.filter.misalignment_process_noise == 5e-2
    assert [part.order for part in data.model.ripple] == [2.0, 4.0]


def test_a_drive_of_another_kind_names_its_orders_and_may_have_no_gear(good):
    assert good.data.model.baseline_orders is None
    orders = "[model]\nbaseline_orders = [1.0, 6]\n"
    text = good.text.replace("gear_ratio = 100.0", "gear_ratio = 1.0").replace("[model]\n", orders)
    assert parse_profile(text, "bench.toml").data.model.baseline_orders == (1.0, 6.0)
    for wrong in ("[]", "[0.0]", "[-2.0]", "[nan]", '["2"]', "2.0"):
        (one,) = problems(text.replace("[1.0, 6]", wrong))
        assert "model.baseline_orders" in one.what
        assert f":{line_of(text, 'baseline_orders')}" in one.where
    (one,) = problems(text.replace("gear_ratio = 1.0", "gear_ratio = 0.5"))
    assert "drive.gear_ratio" in one.what


def test_every_value_of_the_built_in_profile_says_where_it_comes_from(good):
    for line in good.text.splitlines():
        key, _, rest = line.partition("=")
        if rest and not key.startswith("#") and key.strip() not in ("name", "description"):
            _, _, comment = rest.partition("#")
            assert comment.strip().startswith(("report, ", "ours: ")), line


def test_a_profile_is_identified_by_the_hash_of_its_text(good):
    expected = hashlib.sha256(good.text.encode("utf-8")).hexdigest()
    assert good.describe() == {"name": NAME, "sha256": expected}


def test_a_name_and_a_path_load_the_same_profile(good, tmp_path):
    path = tmp_path / "copy.toml"
    path.write_text(good.text, encoding="utf-8")
    assert load_profile(str(path)).data == good.data
    assert NAME in list_profiles()


def test_whole_numbers_stand_for_floats_but_booleans_do_not(good):
    text = good.text.replace("rated_torque_nm = 40.0", "rated_torque_nm = 40")
    value = parse_profile(text, "p").data.drive.rated_torque_nm
    assert (value, type(value)) == (40.0, float)
    (one,) = problems(good.text.replace("rated_torque_nm = 40.0", "rated_torque_nm = true"))
    assert "found true; needed: a number" in one.what


def test_every_error_is_named_at_once_with_line_key_found_needed_and_unit(good):
    text = good.text
    wrong = {
        "drive.gear_ration": ("gear_ratio = 100.0", "gear_ration = 100.0"),
        "drive.rated_torque_nm": ("rated_torque_nm = 40.0", "rated_torque_nm = nan"),
        "sensor.excitation_v": ("excitation_v = 10.0", "excitation_v = inf"),
        "daq.resolution_bits": ("resolution_bits = 16", 'resolution_bits = "16"'),
        "ripple.reference.wave": ('wave = "trapezoid"', 'wave = "sawtooth"'),
        "model.misalignment.amplitude_nm": ("amplitude_nm = 0.9", "amplitude_nm = -0.9"),
        "misalignment.velocity_rad_s": ("velocity_rad_s = 60.0", "velocity_rad_s = 900.0"),
        "daq.deadline_s": ("deadline_s = 0.25", "deadline_s = 0.75"),
        "model.ripple[1].order": ("order = 4.0", "order = 2.0"),
    }
    for old, new in wrong.values():
        assert old in text
        text = text.replace(old, new, 1)
    text += "\n[extra]\nx = 1\n"
    found = problems(text)
    by_key = {error.what.split("'")[1]: error for error in found}
    assert set(by_key) == {*wrong, "drive.gear_ratio", "extra"}
    assert "did you mean 'drive.gear_ratio'" in by_key["drive.gear_ration"].fix
    assert by_key["drive.gear_ratio"].where == f"bench.toml:{line_of(text, '[drive]')}"
    for key, start in [
        ("drive.rated_torque_nm", "rated_torque_nm"),
        ("daq.resolution_bits", "resolution_bits"),
        ("misalignment.velocity_rad_s", "velocity_rad_s = 900"),
        ("extra", "[extra]"),
    ]:
        assert by_key[key].where == f"bench.toml:{line_of(text, start)}"
    assert "found nan; needed: a finite number" in by_key["drive.rated_torque_nm"].what
    assert "N m" in by_key["drive.rated_torque_nm"].what
    assert "400 rad/s" in by_key["misalignment.velocity_rad_s"].what
    order = [int(error.where.split(":")[1]) for error in found]
    assert order == sorted(order)


def test_only_a_calibration_needs_weights_within_the_torque_limit(good):
    text = good.text.replace("torque_nm = 60.0", "torque_nm = 10")
    small = parse_profile(text, "bench.toml")
    with pytest.raises(ProfileError) as caught:
        make_plan("calibration", small)
    (one,) = caught.value.problems
    assert one.where == f"bench.toml:{line_of(text, 'full_masses_kg')}"
    # 8 kg on half a metre at 9.8065 m/s^2
    found = "reaches 39.226 N m; needed: at most limits.torque_nm = 10 N m"
    assert one.what == f"key 'calibration.full_masses_kg': {found}"
    assert make_plan("ripple", small).steps
    check_loads(good)


def test_a_key_in_the_wrong_table_is_told_its_place(good):
    (one,) = problems(good.text.replace("[tacho]\n", "[tacho]\ngear_ratio = 100.0\n"))
    assert "drive.gear_ratio" in one.fix


def test_a_wrong_entry_of_a_list_is_named_and_nothing_is_said_twice(good):
    text = good.text.replace(
        "low_masses_kg = [0.0, 0.5, 1.0, 1.5, 2.0]", "low_masses_kg = [0, '1', -1]"
    )
    keys = [error.what.split("'")[1] for error in problems(text)]
    assert keys == ["calibration.low_masses_kg[1]", "calibration.low_masses_kg[2]"]


def test_an_empty_profile_names_every_missing_table():
    missing = {error.what.split("'")[1] for error in problems('name = "x"\n')}
    assert missing == set(profile_schema()["required"]) - {"name"}


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ('name = "x\n', "bench.toml:1:10"),
        ("a = 1\nb = = 2\n", "bench.toml:2:5"),
        ("[a]\nx = 1\nx = 2\n", "bench.toml:3:6"),
        ("[a]\n[b]\n[a]\n", "bench.toml:3:3"),
    ],
)
def test_a_syntax_error_has_line_and_column(text, place):
    with pytest.raises(ProfileError) as caught:
        parse_profile(text, "bench.toml")
    assert caught.value.where == place


def test_several_bad_profiles_are_named_together(good, tmp_path):
    paths = [tmp_path / f"{name}.toml" for name in "abc"]
    paths[0].write_text(good.text.replace("gear_ratio = 100.0", "gear_ratio = 0.5"))
    paths[1].write_text(good.text)
    paths[2].write_bytes(b"name = '\xff'\n")
    with pytest.raises(ProfileError) as caught:
        check_profiles([str(path) for path in paths])
    assert [Path(e.where).name.split(":")[0] for e in caught.value.problems] == ["a.toml", "c.toml"]


@pytest.mark.parametrize("name", ["", "nope", "/", "a\0b", "../../etc/passwd", "x" * 5000])
def test_a_profile_that_is_not_there_is_an_error_with_a_fix(name):
    with pytest.raises(ProfileError) as caught:
        load_profile(name)
    assert caught.value.fix


def test_a_new_profile_is_valid_and_explains_every_key():
    text = new_profile("my-bench")
    profile = parse_profile(text, "new")
    built_in = load_profile(NAME).data.model_dump()
    changed = {k: v for k, v in profile.data.model_dump().items() if v != built_in[k]}
    assert set(changed) == {"name", "description"}
    lines = text.splitlines()
    for before, line in itertools.pairwise(lines):
        if "=" in line and not line.startswith(("#", "name", "description")):
            assert before.startswith("#"), line
    with pytest.raises(ProfileError):
        new_profile("../x")


def test_the_schema_describes_every_key():
    schema = profile_schema()
    tables = [schema, *schema["$defs"].values()]
    keys = [(name, body) for t in tables for name, body in t["properties"].items()]
    assert [name for name, body in keys if "description" not in body and "$ref" not in body] == []


def outcome(text):
    """Return the error that a text ends in; anything but a ProfileError is a failure."""
    try:
        parse_profile(text, "p.toml")
    except ProfileError as error:
        return error
    return None


ODD = st.sampled_from(
    ["nan", "-inf", "1e400", "-1", "0", "true", '""', "[]", "{}", "2026-01-01", "[[1]]", "1" * 400]
)


@given(st.integers(0, 10_000), ODD)
@settings(max_examples=80)
@example(0, "1" * 400)
def test_no_value_at_any_key_ends_in_anything_but_a_profile_error(place, value):
    lines = load_profile(NAME).text.splitlines()
    spots = [i for i, line in enumerate(lines) if "=" in line and not line.startswith("#")]
    spot = spots[place % len(spots)]
    lines[spot] = f"{lines[spot].partition('=')[0]}= {value}"
    error = outcome("\n".join(lines))
    if error is not None:
        assert error.problems or "not TOML" in error.what
        assert all(one.where.startswith("p.toml:") for one in error.problems)


@given(
    st.integers(0, 6000),
    st.integers(0, 40),
    st.text(st.characters(codec="utf-8") | st.sampled_from("[]{}=.\"'#\n\\\0"), max_size=12) | ODD,
)
@settings(max_examples=60)
def test_no_damage_to_the_text_ends_in_anything_but_a_profile_error(start, length, insert):
    text = load_profile(NAME).text
    damaged = text[:start] + insert + text[start + length :]
    error = outcome(damaged)
    if error is None:
        assert tomllib.loads(damaged)["name"]
    else:
        assert error.where.startswith("p.toml")
        assert all((error.what, error.fix))
