"""Applied torque: gravity, air, arm, tilt, hanging point, and what each is uncertain by."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdbench.calibration import lever
from hdbench.calibration.readings import taken_readings
from hdbench.errors import ProfileError
from hdbench.profile import load_profile, parse_profile
from hdbench.profile.calibrating import (
    Arm,
    LengthStandard,
    MassStandard,
    Standards,
    gravity_welmec,
    gravity_wgs84,
)
from hdbench.records import LoadReading, Loads

# the arm of a published example: 40 N m class, 8 kg on half a metre, hung 20 mm below the axis line
ARM = Arm(
    length_m=0.5,
    gravity_m_s2=9.80650,
    gravity_half_width_m_s2=20e-6 * 9.80650,
    thermal_expansion_per_k=11.5e-6,
    temperature_half_width_k=1.0,
    tilt_rad=math.radians(0.2),
    tilt_half_width_rad=math.radians(0.2),
    torsional_stiffness_nm_per_rad=1.2e4,
    hang_offset_m=0.020,
    hang_offset_half_width_m=0.002,
    cant_half_width_rad=math.radians(0.5),
    air_density_kg_m3=1.18587,
)
STANDARDS = Standards(
    mass=MassStandard(accuracy_class="M1"), length=LengthStandard(half_width_m=1e-4)
)
BENCH = load_profile("cim-tr-97-06")
WARM = lever.Conditions(temperature_c=21.5)


def arm_of(text: str) -> Arm:
    """Return the arm of a profile that says this of it."""
    given = BENCH.text
    before, after = given[: given.index("[arm]")], given[given.index("[calibration]") :]
    return parse_profile(f"{before}[arm]\n{text}\n\n{after}", "p").data.arm


def test_gravity_by_welmec_is_that_of_the_package_that_documents_it():
    # documentation of AHRS, function welmec_gravity, to its last digit
    assert gravity_welmec(52.3, 80.0) == pytest.approx(9.812483709897048, rel=1e-15)


def test_normal_gravity_has_the_ellipsoid_values_of_equator_and_pole():
    # WGS 84, NIMA TR8350.2 table 3.4: 9.7803253359 and 9.8321849378 m/s^2, ten decimals
    assert gravity_wgs84(0.0, 0.0) == pytest.approx(9.7803253359, abs=5e-11)
    assert gravity_wgs84(90.0, 0.0) == pytest.approx(9.8321849378, abs=5e-10)
    assert gravity_wgs84(-90.0, 0.0) == gravity_wgs84(90.0, 0.0)


def test_both_gravity_formulas_agree_to_a_few_parts_per_million_where_people_live():
    for latitude, height, wgs84 in [(45.5048, 50.0, 9.80650039), (52.3, 80.0, 9.81249069)]:
        assert gravity_wgs84(latitude, height) == pytest.approx(wgs84, abs=5e-9)
        assert gravity_welmec(latitude, height) == pytest.approx(wgs84, rel=2e-6)


def test_the_profile_takes_gravity_from_latitude_and_height_and_says_so():
    arm = arm_of("length_m = 0.5\nlatitude_deg = 45.5048\naltitude_m = 50")
    assert (arm.gravity_m_s2, arm.gravity_source) == (gravity_wgs84(45.5048, 50.0), "wgs84")
    given = arm_of("length_m = 0.5\ngravity_m_s2 = 9.81\nlatitude_deg = 0.0\naltitude_m = 0")
    assert (given.gravity_m_s2, given.gravity_source) == (9.81, "given")


@pytest.mark.parametrize("text", ["length_m = 0.5", "length_m = 0.5\nlatitude_deg = 45.0"])
def test_a_bench_without_gravity_and_place_is_refused(text):
    with pytest.raises(ProfileError, match="latitude_deg and altitude_m"):
        arm_of(text)


def test_air_density_is_that_of_the_published_formula():
    # OIML R 111-1 equation E.3-1, worked at two states of air, five decimals
    assert lever.air_density(1013.25, 50.0, 20.0) == pytest.approx(1.19929, abs=5e-6)
    assert lever.air_density(1007.0, 45.0, 21.5) == pytest.approx(1.18587, abs=5e-6)
    with pytest.raises(ValueError, match="needed"):
        lever.air_density(1013.0, 50.0, math.nan)


def test_conventional_mass_and_buoyancy_have_the_published_sizes():
    steel, in_air = lever.buoyancy_factors(1.18587, 7850.0, conventional=True)
    iron, _ = lever.buoyancy_factors(1.18587, 7100.0, conventional=True)
    # 2.9 and 19 ppm as printed; in air of 1.2 kg/m^3 a conventional mass of any density weighs
    # like one of 8000 kg/m^3: -150 ppm
    assert 1e6 * (steel - 1.0) == pytest.approx(2.9, abs=0.05)
    assert 1e6 * (iron - 1.0) == pytest.approx(19.0, abs=0.5)
    assert 1e6 * (steel * in_air - 1.0) == pytest.approx(-148.0, abs=0.5)
    for density in (2700.0, 7100.0, 8000.0, 16600.0):
        true, pressed = lever.buoyancy_factors(1.2, density, conventional=True)
        assert true * pressed == pytest.approx(1.0 - 1.2 / 8000.0, rel=1e-12)


def test_eight_kilograms_on_half_a_metre_give_the_published_torque_and_corrections():
    applied = lever.applied_torque(8.0, ARM, STANDARDS.mass, WARM)
    assert applied.torque_nm == pytest.approx(39.20937, abs=5e-6)
    assert 1e6 * (applied.torque_nm / (8.0 * 9.80665 * 0.5) - 1.0) == pytest.approx(-440, abs=1.0)
    assert math.degrees(applied.tilt_rad) == pytest.approx(0.387, abs=5e-4)
    sizes = {c.name: 1e6 * c.relative for c in applied.corrections}
    assert sizes["conventional mass"] + sizes["air buoyancy"] == pytest.approx(-148.0, abs=0.5)
    assert sizes["arm temperature"] == pytest.approx(17.0, abs=0.5)
    assert sizes["arm tilt"] == pytest.approx(-23.0, abs=0.5)
    assert sizes["hang-point offset"] == pytest.approx(-270.0, abs=0.5)
    product = math.prod(1.0 + c.relative for c in applied.corrections)
    # the corrections together are the torque, but for e's being taken on cos a: rounding
    assert applied.nominal_nm * product == pytest.approx(applied.torque_nm, rel=1e-12)


def test_the_budget_of_the_applied_torque_has_the_published_sizes():
    applied = lever.applied_torque(8.0, ARM, STANDARDS.mass, WARM)
    ppm = {r.name: 1e6 * r.relative_std for r in lever.torque_sources(applied, ARM, STANDARDS)}
    printed = {
        "mass of the weights": 29.0,
        "arm length": 115.0,
        "cant of the arm": 38.0,
        "local gravity": 12.0,
        "hang-point offset": 16.0,
        "air density": 7.0,
        "arm temperature": 7.0,
    }
    for name, size in printed.items():
        assert ppm[name] == pytest.approx(size, abs=0.55), name
    # the published 14 ppm of the tilt hold for a hanging point on the axis line
    level = ARM.model_copy(update={"hang_offset_m": 0.0})
    flat = lever.applied_torque(8.0, level, STANDARDS.mass, WARM)
    tilt = next(r for r in lever.torque_sources(flat, level, STANDARDS) if r.name == "arm tilt")
    assert 1e6 * tilt.relative_std == pytest.approx(14.0, abs=0.55)


@given(tilt=st.floats(-0.02, 0.02), offset=st.floats(-0.05, 0.05), mass=st.floats(0.5, 10.0))
def test_sensitivities_are_the_derivatives_of_the_torque(tilt, offset, mass):
    halves = {"tilt_half_width_rad": 1e-3, "hang_offset_half_width_m": 1e-3}
    turned = {"tilt_rad": tilt, "hang_offset_m": offset}
    arm = Arm(length_m=0.5, gravity_m_s2=9.8, **turned, **halves)
    applied = lever.applied_torque(mass, arm, MassStandard())
    rows = {r.name: r.sensitivity for r in lever.torque_sources(applied, arm, Standards())}
    step = 1e-6

    def slope(key: str, at: float) -> float:
        ends = [
            lever.applied_torque(
                mass, arm.model_copy(update={key: at + d}), MassStandard()
            ).torque_nm
            for d in (-step, step)
        ]
        return abs(ends[1] - ends[0]) / (2.0 * step) / applied.torque_nm

    # central differences of step 1e-6: error 1e-12 relative to the third derivative, rounding 1e-9
    assert rows["arm tilt"] == pytest.approx(slope("tilt_rad", tilt), abs=1e-8)
    assert rows["hang-point offset"] == pytest.approx(slope("hang_offset_m", offset), abs=1e-8)


def test_what_is_not_declared_is_not_corrected_and_has_no_size():
    bare = Arm(length_m=0.5, gravity_m_s2=9.8)
    applied = lever.applied_torque(4.0, bare, MassStandard())
    assert applied.torque_nm == 4.0 * 9.8 * 0.5
    assert not any(c.made for c in applied.corrections if c.name in ("air buoyancy", "arm tilt"))
    rows = lever.torque_sources(applied, bare, Standards())
    assert all(row.relative_std == 0.0 and not row.declared for row in rows)


def test_gravity_by_formula_is_uncertain_by_local_anomalies():
    there = Arm(length_m=0.5, latitude_deg=45.5, altitude_m=50.0)
    applied = lever.applied_torque(4.0, there, MassStandard())
    row = next(
        r for r in lever.torque_sources(applied, there, Standards()) if r.name == "local gravity"
    )
    # limits of 50 ppm, rectangular: 29 ppm
    assert 1e6 * row.relative_std == pytest.approx(29.0, abs=0.5)


@pytest.mark.parametrize("mass", [math.nan, math.inf, -1.0])
def test_no_torque_is_made_of_an_impossible_mass(mass):
    with pytest.raises(ValueError, match="mass"):
        lever.applied_torque(mass, ARM, MassStandard())


def test_torques_of_masses_are_corrected_and_given_torques_stay():
    arm = ARM.model_copy(update={"gravity_m_s2": 9.8065})
    bench = BENCH.data.model_copy(update={"arm": arm})
    nominal = 8.0 * 9.8065 * 0.5
    hung = {"mass_kg": 8.0, "temperature_c": 21.5}
    rows = [
        LoadReading("a", 0.0, "full", "cw", "up", nominal, 6.0, **hung),
        LoadReading("a", 0.0, "full", "ccw", "up", -nominal, -6.0, **hung),
        LoadReading("a", 0.0, "full", "cw", "up", 39.0, 6.0, **hung),
        LoadReading("a", 0.0, "full", "cw", "up", 39.0, 6.0),
    ]
    out, account = lever.apply_torque(taken_readings(Loads(tuple(rows))), bench)
    torques = [t.reading.torque_nm for t in out]
    assert torques[:2] == pytest.approx([39.209365525, -39.209365525], rel=1e-9)
    assert torques[2:] == [39.0, 39.0]
    assert account.source == "mixed"


def test_another_arm_length_of_a_row_is_used():
    arm = BENCH.data.arm
    nominal = 2.0 * arm.gravity_m_s2 * arm.length_m
    reading = LoadReading("a", 0.0, "full", "cw", "up", nominal, 1.0, mass_kg=2.0)
    loads = Loads((reading,), extra_columns={"arm_length_m": ("0.25",)})
    out, _ = lever.apply_torque(taken_readings(loads), BENCH.data)
    assert out[0].reading.torque_nm == pytest.approx(2.0 * arm.gravity_m_s2 * 0.25)
