"""Effects of a misplaced rosette, against closed forms."""

import math

import numpy as np
import pytest

from hdbench.errors import UsageError
from hdbench.gauges import Tolerance, tabulate_errors
from hdbench.gauges.layout import LAYOUTS, cancellation
from hdbench.gauges.misplacement import closed_form_ripple, placement_effects
from hdbench.gauges.strain import PlacementErrors, Wave, off_centre

# the bridge's own nonlinearity at 200 microstrain: K e = 4e-4 of the wave it multiplies
BRIDGE = 1e-3


def off(count: int, **kinds: float) -> PlacementErrors:
    """Return one draw with the first rosette off."""
    sizes = (kinds.get(kind, 0.0) for kind in ("radial", "circumferential", "angular"))
    return PlacementErrors(*(size * np.eye(1, count) for size in sizes))


@pytest.mark.parametrize("degrees", [0.5, 1.0, 2.0, 10.0])
def test_one_wrong_rosette_of_two_leaves_a_sin_delta_and_half_of_it_of_four(bench, degrees):
    # A: strain of a pair, 200 microstrain, read as torsion of 2 x 7.5758 microstrain per N m
    amplitude = 200e-6 / (2.0 * 303.030303e-6 / 40.0)
    for name, count in (("two", 2), ("four", 4)):
        gauged = bench(name)
        assert gauged.uncancelled_nm(gauged.field.waves[0]) == pytest.approx(amplitude, rel=1e-8)
        found = placement_effects(gauged, off(count, circumferential=math.radians(degrees)))
        expected = 2.0 / count * amplitude * math.sin(math.radians(degrees))
        assert found["ripple_2_nm"][0] == pytest.approx(expected, rel=BRIDGE)


@pytest.mark.parametrize("layout", ["two", "four", "spread"])
def test_the_closed_form_holds_for_every_layout_that_cancels(bench, layout):
    gauged = bench(layout, fourth=20e-6)
    count = len(gauged.layout.rosettes)
    delta = math.radians(3.0)
    found = placement_effects(gauged, off(count, circumferential=delta))
    expected = closed_form_ripple(gauged, Wave(2.0, 200e-6), delta)
    assert found["ripple_2_nm"][0] == pytest.approx(expected, rel=5 * BRIDGE)


def test_right_angles_cancel_order_2_and_keep_order_4():
    for name, of_order_4 in (("two", 1.0), ("four", 1.0), ("spread", 0.0)):
        found = [cancellation(LAYOUTS[name], order) for order in (2.0, 4.0)]
        assert found == pytest.approx([0.0, of_order_4], abs=1e-12)


def test_the_bridge_shows_what_the_phasors_say_of_order_4(bench):
    fourth = 20e-6
    for name, left in (("two", 1.0), ("four", 1.0), ("spread", 0.0)):
        gauged = bench(name, second=0.0, fourth=fourth)
        found = placement_effects(gauged, PlacementErrors.none(1, len(gauged.layout.rosettes)))
        expected = left * fourth / (2.0 * 303.030303e-6 / 40.0)
        assert found["ripple_4_nm"][0] == pytest.approx(expected, rel=BRIDGE, abs=1e-9)
        assert found["ripple_2_nm"][0] == pytest.approx(0.0, abs=1e-9)


def test_a_turned_rosette_is_as_bad_as_a_shifted_one_where_normal_equals_shear(bench):
    # the report: "sensing inaccuracy similar to the circumferential positioning error"
    gauged = bench("four", normal=1.0)
    delta = math.radians(1.0)
    shifted = placement_effects(gauged, off(4, circumferential=delta))["ripple_2_nm"][0]
    turned = placement_effects(gauged, off(4, angular=delta))["ripple_2_nm"][0]
    assert turned == pytest.approx(shifted, rel=BRIDGE)
    without = placement_effects(bench("four", normal=0.0), off(4, angular=delta))["ripple_2_nm"][0]
    # shear alone: cos 2 delta of one rosette, A/4 (1 - cos 2 delta)
    assert without == pytest.approx(13.2 / 4.0 * (1.0 - math.cos(2.0 * delta)), rel=0.05)


def test_a_turned_rosette_loses_gain_as_cos_2_delta(bench):
    gauged = bench("two", second=0.0)
    delta = math.radians(5.0)
    found = placement_effects(gauged, off(2, angular=delta))
    assert found["gain_change"][0] == pytest.approx(0.5 * (math.cos(2.0 * delta) - 1.0), rel=1e-6)


def test_a_rosette_too_far_out_sees_torsion_of_one_over_r_squared(bench):
    gauged = bench("two", second=0.0)
    found = placement_effects(gauged, off(2, radial=1.0))
    assert found["gain_change"][0] == pytest.approx(0.5 * ((16.5 / 17.5) ** 2 - 1.0), rel=1e-6)


def test_the_reversed_rosettes_take_the_zero_of_unequal_radii_away(bench):
    # R5 and R6 "in the reverse position": the report's reason for four rosettes
    two = bench("two", spacing=3.6, assembly_strain=200e-6)
    four = bench("four", spacing=3.6, assembly_strain=200e-6)
    zero_two = placement_effects(two, PlacementErrors.none(1, 2))["zero_nm"][0]
    zero_four = placement_effects(four, PlacementErrors.none(1, 4))["zero_nm"][0]
    # at 45 degrees a grid sees half of S: a pair differs by S/2 spacing / r; torsion has 2 strains
    expected = 0.5 * 200e-6 * 3.6 / 16.5 / (2.0 * 303.030303e-6 / 40.0)
    assert abs(zero_two) == pytest.approx(expected, rel=BRIDGE)
    assert abs(zero_four) < 1e-9


def test_the_same_seed_draws_the_same_and_another_one_within_the_interval(bench):
    gauged, tolerance = bench("four"), Tolerance(0.2, 1.0, 1.0)
    first, again, other = (
        tabulate_errors(gauged, tolerance, draws=1000, seed=seed) for seed in (1, 1, 2)
    )
    assert first.to_dict() == again.to_dict()
    for a, b in zip(first.scatter, other.scatter, strict=True):
        for q, r in zip(a.effects["ripple_2_nm"], b.effects["ripple_2_nm"], strict=True):
            # two independent 95 % intervals; a gap of twice their width has probability below 1e-6
            assert abs(q.value - r.value) <= 2.0 * (q.high - q.low) + 1e-12


def test_the_scatter_of_small_circumferential_errors_is_that_of_the_sum_of_phasors(bench):
    # linear for small errors: ripple = A/4 |sum of +- 2 delta_i|, drawn here on its own
    tolerance = Tolerance(0.0, 1.0, 0.0)
    table = tabulate_errors(bench("four"), tolerance, draws=6000, seed=5)
    found = {q.share: q for q in table.scatter[1].effects["ripple_2_nm"]}
    delta = np.random.default_rng(77).uniform(-1.0, 1.0, (100_000, 4))
    ripple = 13.2 / 2.0 * np.abs(math.radians(1.0) * (delta @ np.array([1.0, -1.0, 1.0, -1.0])))
    for share, q in found.items():
        expected = float(np.quantile(ripple, share))
        # 1.5 widths of the 95 % interval are six standard deviations
        assert abs(q.value - expected) < 1.5 * (q.high - q.low) < 0.15 * expected
        assert q.low <= q.value <= q.high


def test_a_tolerance_that_reaches_the_axis_is_refused(bench):
    with pytest.raises(UsageError, match="radial tolerance"):
        tabulate_errors(bench(), Tolerance(9.0, 1.0, 1.0))


def test_a_film_off_centre_cancels_in_four_rosettes_and_not_in_two(bench):
    # first order in e/r, shear alone, strain growing with r: radii e cos and e sin, angles e/r sin
    # and -e/r cos, so A/2 e/r sqrt((cos - sin)^2 + 4 (cos + sin)^2) with two rosettes
    shift, towards = np.full(8, 0.2), np.arange(8) * np.pi / 4.0
    cosine, sine = np.cos(towards), np.sin(towards)
    expected = 13.2 / 2.0 * 0.2 / 16.5 * np.hypot(cosine - sine, 2.0 * (cosine + sine))
    found = {}
    for name in ("two", "four"):
        gauged = bench(name)
        errors = off_centre(gauged.layout, gauged.geometry, shift, towards)
        found[name] = placement_effects(gauged, errors)["ripple_2_nm"]
    # the second order is e/r = 1.2 % of the first
    assert found["two"] == pytest.approx(expected, rel=0.013)
    assert found["four"].max() < 0.02 * found["two"].max()


def test_a_shifted_film_moves_each_rosette_as_a_rigid_body(bench):
    gauged = bench("four")
    errors = off_centre(gauged.layout, gauged.geometry, np.array([0.5]), np.array([0.0]))
    # towards the first rosette: it goes out, the third in, the others along the circumference
    assert errors.radial_mm[0] == pytest.approx([0.5, 0.0076, -0.5, 0.0076], abs=1e-4)
    along = math.atan2(0.5, 16.5)
    assert errors.circumferential_rad[0] == pytest.approx([0.0, -along, 0.0, along], abs=1e-12)
    assert errors.angular_rad[0] == pytest.approx([0.0, along, 0.0, -along], abs=1e-12)
