"""Hidden effects in calibration loads are named, clean ones are left alone."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import static_bench as bench
from load_readings import simulate_loads

from hdbench.diagnosis import DiagnosisOptions, diagnose_run
from hdbench.diagnosis.static import diagnose_loads
from hdbench.errors import DataError
from hdbench.importing.importer import import_files
from hdbench.importing.recipe import Recipe
from hdbench.profile import load_profile
from hdbench.records import Loads, read_loads
from hdbench.records.loads import write_loads

PROFILE = load_profile("cim-tr-97-06")
DATA = os.environ.get("HDBENCH_DATA")
needs_data = pytest.mark.skipif(not DATA, reason="HDBENCH_DATA is not set")
NOISE_NM = 0.01
# what a name may stand beside: one group of the contract, or forms of one curve
GROUPS = {"side-force": {"direction-asymmetry", "side-force"}}


def hidden(name, sigmas, seed):
    rng = np.random.default_rng([41, seed, *name.encode()])
    p = bench.plan(rng, levels=6)
    return p, bench.readings(p, bench.sized(name, p, sigmas, NOISE_NM, rng), NOISE_NM, rng)


def loaded(seed, effect=None, *, timed=True, clamping=0.0, **shape):
    """Return the plan and the readings of an effect, a function of the plan."""
    rng = np.random.default_rng(seed)
    p = bench.plan(rng, **shape)
    torque = np.zeros(len(p.torque)) if effect is None else effect(p)
    return p, bench.readings(p, torque, NOISE_NM, rng, timed=timed, clamping=clamping)


def marked(shown, *campaign):
    """Parametrize: what is shown in every run, and what a campaign adds."""
    return [*shown, *(pytest.param(one, marks=pytest.mark.campaign) for one in campaign)]


NAMES = (
    "hysteresis", "cubic-nonlinearity", "creep", "position-dependent-gain",
    "direction-asymmetry", "warm-up", "backlash",
)  # fmt: skip


@pytest.mark.parametrize(
    "name", marked(NAMES, "saturation", "arm-sag", "side-force", "zero-drift", "zero-step")
)
def test_a_hidden_effect_is_named_alone(name):
    _, loads = hidden(name, 30.0, 1)
    result = diagnose_loads(loads, PROFILE)
    assert result.verdict == "named"
    (cause,) = result.causes
    assert {name} & {cause.name, *cause.group, *cause.rivals} or GROUPS[name] & set(cause.group)
    assert cause.false_alarm_probability < 1e-4
    assert cause.gain.explained_fraction > 0.5
    assert result.extended.heldout_rms_nm < result.simulated.heldout_rms_nm


def test_clean_readings_show_nothing():
    found = 0
    for seed in range(8):
        _, loads = loaded([42, seed], timed=seed % 2 == 0)
        result = diagnose_loads(loads, PROFILE, materiality=0.0)
        found += result.verdict != "nothing-found"
        smallest = {one.name: one.amplitude_nm for one in result.minimum_detectable}
        assert smallest["hysteresis"] < 0.05
    # at 1 % each: two of eight by chance once in 380
    assert found <= 1


@pytest.mark.parametrize("seed", marked([0], 1, 2))
def test_gains_that_scatter_from_clamping_to_clamping_are_no_cause(seed):
    _, loads = loaded([43, seed], ranges=2, clamping=0.01)
    result = diagnose_loads(loads, PROFILE)
    assert result.causes == result.unexplained == ()
    scatter = result.settings["gain_scatter"]
    assert scatter["within_profile"]
    # 16 experiments: four standard deviations of a standard deviation of 15 degrees of freedom
    assert 0.002 < scatter["relative_std"] < 0.018
    assert "without a form" in result.reason


def test_more_scatter_than_the_profile_states_is_unexplained():
    _, loads = loaded(44, ranges=2, clamping=0.1)
    result = diagnose_loads(loads, PROFILE)
    assert result.verdict == "unexplained"
    assert [(place.domain, place.unit) for place in result.unexplained] == [("torque", "N m")]


def test_a_direction_stands_above_scattering_gains():
    _, loads = loaded(
        45, lambda p: 0.02 * np.where(p.cw, p.torque, 0.0), positions=8, clamping=0.002
    )
    (cause,) = diagnose_loads(loads, PROFILE).causes
    assert set(cause.group) == {"direction-asymmetry", "side-force"}
    # one of the group; a side force is told in N m at 10 N m
    times = {"asymmetry": 1.0, "side_nm": 0.1}
    (name,) = times.keys() & cause.parameters.keys()
    size = cause.parameters[name]
    value, std = times[name] * size.value, times[name] * size.std
    # half of 2 % is even in the torque; 0.2 % of scatter over 16 gains leaves 0.05 %
    assert abs(value - 0.01) < 4.0 * std
    assert 2e-4 < std < 1e-3


@pytest.mark.campaign
def test_the_parameters_of_a_cubic_have_true_intervals():
    deviations = []
    for seed in range(6):
        _, loads = loaded([46, seed], lambda p: 2e-6 * p.torque**3, positions=2, levels=6)
        (cause,) = diagnose_loads(loads, PROFILE).causes
        if cause.name == "cubic-nonlinearity":
            entry = cause.parameters["cubic_nm"]
            deviations.append((entry.value - 2e-3) / entry.std)
    assert len(deviations) >= 4
    # the mean square of n standard normal values is below 4 but once in 3000 for n = 4
    assert np.mean(np.square(deviations)) < 4.0


def test_one_wrong_weight_is_told_with_the_mass_that_fits():
    pull = bench.GRAVITY * bench.ARM_M

    def added(p):
        return np.where(np.arange(len(p.torque)) == 13, 0.4 * pull * np.sign(p.torque), 0.0)

    p, loads = loaded(47, added, positions=3)
    result = diagnose_loads(loads, PROFILE)
    assert result.causes == ()
    (place,) = result.unexplained
    assert (place.domain, place.location, place.unit) == ("outliers", 14.0, "reading")
    (entry,) = result.settings["outliers"]
    mass = abs(p.torque[13]) / pull + 0.4
    # 10 mN m of noise are 2 g on an arm of half a metre
    assert entry["fitting_mass_kg"] == pytest.approx(mass, abs=0.02)
    assert [flag.name for flag in result.data_flags] == ["outlier"]


def test_readings_at_the_end_of_the_converter_are_left_out():
    _, loads = hidden("hysteresis", 0.0, 2)
    readings = list(loads.readings)
    for i in (3, 4):
        readings[i] = replace(readings[i], reading_v=PROFILE.data.daq.range_v)
    result = diagnose_loads(Loads(tuple(readings)), PROFILE)
    assert [(f.name, f.samples) for f in result.data_flags] == [("saturation", 2)]
    assert result.verdict == "nothing-found"
    assert not result.load_pictures["used"][[3, 4]].any()


@pytest.mark.parametrize("name", marked(["hysteresis"], "saturation", "position-dependent-gain"))
def test_readings_of_the_extended_model_show_nothing_more(name):
    _, loads = hidden(name, 40.0, 3)
    model = diagnose_loads(loads, PROFILE).model
    assert [term.name for term in model.causes] == [name]
    rng = np.random.default_rng(48)
    clean = simulate_loads(model, loads, PROFILE.data)
    noisy = tuple(
        replace(r, reading_v=r.reading_v + NOISE_NM / bench.GAIN * rng.standard_normal())
        for r in clean.readings
    )
    again = diagnose_loads(Loads(noisy), PROFILE, model=model, materiality=0.0)
    assert again.verdict == "nothing-found"
    blind = diagnose_loads(Loads(noisy), PROFILE)
    assert [cause.name for cause in blind.causes] == [name]


def test_the_pictures_hold_what_was_fitted():
    p, loads = hidden("hysteresis", 60.0, 4)
    result = diagnose_loads(loads, PROFILE)
    pictures = result.load_pictures
    assert pictures["reading"][0] == 1
    assert pictures["torque_nm"].tolist() == p.torque.tolist()
    left = pictures["measured_nm"] - pictures["extended_nm"]
    assert np.allclose(left, pictures["residual_after_nm"], rtol=0.0, atol=1e-9)
    assert pictures["residual_after_nm"].std() < 1.3 * NOISE_NM
    assert pictures["residual_before_nm"].std() > 3.0 * NOISE_NM


def test_two_times_the_same_readings_give_the_same_answer():
    _, loads = hidden("creep", 12.0, 5)
    first, second = (diagnose_loads(loads, PROFILE).to_json() for _ in range(2))
    assert first == second
    assert json.loads(json.dumps(first, allow_nan=False))["verdict"] == "named"


def test_a_trace_in_the_place_of_readings_is_refused():
    _, loads = hidden("creep", 0.0, 7)
    with pytest.raises(DataError, match="at most 2000"):
        diagnose_loads(Loads(loads.readings * 40), PROFILE)


@pytest.mark.parametrize(
    ("kept", "change", "verdict", "says"),
    [
        (1, {}, "data-bad", "readings do not fix one gain"),
        (4, {}, "data-bad", "readings do not fix one gain"),
        (5, {}, "cannot-tell", "3 degrees of freedom"),
        (40, {"reading_v": 0.25}, "data-bad", "0 readings do not fix"),
    ],
)
def test_what_readings_cannot_tell_is_said(kept, change, verdict, says):
    _, loads = hidden("creep", 0.0, 7)
    readings = tuple(replace(reading, **change) for reading in loads.readings[:kept])
    result = diagnose_loads(Loads(readings), PROFILE)
    assert result.verdict == verdict
    assert says in result.reason


@pytest.mark.parametrize("bad", [{"alpha": 0.0}, {"alpha": float("nan")}, {"materiality": 1.0}])
def test_rates_out_of_their_domain_are_refused(bad):
    _, loads = hidden("creep", 0.0, 9)
    with pytest.raises(ValueError, match="must be in"):
        diagnose_loads(loads, PROFILE, **bad)


@needs_data
@pytest.mark.parametrize("instrument", marked(["torque_arm"], "drag_right", "drag_left"))
def test_hysteresis_of_real_load_cells_is_named(instrument, tmp_path):
    folder = Path(DATA) / "unh_torque_arm_cal"
    column = "mean_torque" if instrument == "torque_arm" else "mean_force_newtons"
    files = [folder / f"{instrument}_{series}.csv" for series in ("ascending", "descending")]
    maps = {"torque_nm": column, "reading_v": "mean_volts_per_volt"}
    same = {"experiment": "arm", "position_rad": "0", "range": "full", "direction": "cw"}
    constants = {**same, "1:series": "up", "2:series": "down"}
    out = tmp_path / "loads.csv"
    import_files(Recipe("loads", maps, constants), files, out)
    result = diagnose_loads(read_loads(out, None), PROFILE)
    names = {cause.name for cause in result.causes}
    assert "hysteresis" in names
    assert result.unexplained == ()
    # of the arm the mean of both branches bends by 0.6 % of its range beside the loop
    assert names <= {"hysteresis", "cubic-nonlinearity"}
    assert len(names) == (2 if instrument == "torque_arm" else 1)


def test_a_cause_file_reaches_calibration_loads(tmp_path):
    # even in the load and of fourth power: nothing of the catalogue grows so
    _, loads = loaded(43, lambda p: 0.3 * (p.torque / np.abs(p.torque).max()) ** 4, levels=6)
    file = tmp_path / "loads.csv"
    write_loads(file, loads)
    own = tmp_path / "own.toml"
    own.write_text(
        '[[cause]]\nname = "swelling"\nkind = "polynomial"\nover = "load"\npowers = [4]\n'
        "scale = 20.0\n",
        encoding="utf-8",
    )
    options = DiagnosisOptions(cause_files=(own,))
    _, result = diagnose_run(file, PROFILE, out=tmp_path / "runs", options=options)
    assert [cause.name for cause in result.causes] == ["swelling"]
    _, without = diagnose_run(file, PROFILE, out=tmp_path / "runs")
    assert "swelling" not in {cause.name for cause in without.causes}


def test_preloads_and_shunt_readings_are_not_diagnosed():
    _, loads = hidden("hysteresis", 30.0, 2)
    first = loads.readings[0]
    extra = (
        replace(first, experiment="before", torque_nm=40.0, reading_v=9.0),
        replace(first, torque_nm=0.0, reading_v=6.06),
    )
    kinds = ("preload", "shunt", *[""] * len(loads))
    more = Loads((*extra, *loads.readings), extra_columns={"kind": kinds})
    plain, found = diagnose_loads(loads, PROFILE), diagnose_loads(more, PROFILE)
    assert found.verdict == plain.verdict
    assert [cause.name for cause in found.causes] == [cause.name for cause in plain.causes]
    assert found.unexplained == plain.unexplained
