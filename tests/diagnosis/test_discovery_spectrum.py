"""Spectrum of the noise: white, a pole and 1/f are recovered from one record and from theory."""

import numpy as np
import pytest
from scipy import signal

from hdbench.diagnosis.discovery.bands import make_bands
from hdbench.diagnosis.discovery.spectrum import make_shapes

N, PERIOD_S = 20_000, 1e-3
BANDS = make_bands(np.ones(N, dtype=bool), PERIOD_S)
SHAPES = make_shapes(BANDS.frequency_hz, 1e-12)
HERTZ = np.maximum(np.arange(BANDS.length), 0.5) / (2.0 * BANDS.length * PERIOD_S)
# a single coefficient at the very start stands for no band
TOLD = np.diff(BANDS.edges) >= 3


def theory(kind, hertz):
    """Return the power of each coefficient, (N m)^2."""
    if kind == "white":
        return np.full(len(hertz), 0.05**2)
    if kind == "pole":
        response = signal.freqz([1.0], [1.0, -0.9], worN=hertz, fs=1.0 / PERIOD_S)[1]
        return 0.02**2 * np.abs(response) ** 2
    return 1e-4 * (1.0 + 20.0 / hertz)


def means(power):
    """Return the mean over the coefficients of each band."""
    return np.add.reduceat(power, BANDS.edges[:-1]) / np.diff(BANDS.edges)


def in_bands(kind):
    return means(theory(kind, HERTZ))


def simulated(kind, rng):
    """Return the mean square of each band of one record."""
    if kind == "1/f":
        row = np.sqrt(theory(kind, HERTZ)) * rng.standard_normal(BANDS.length)
        return BANDS.power(row) / np.diff(BANDS.edges)
    white = rng.standard_normal(N + 500)
    noise = 0.05 * white if kind == "white" else 0.02 * signal.lfilter([1.0], [1.0, -0.9], white)
    return BANDS.power(BANDS.transform(noise[500:, None])[0]) / BANDS.counts


KINDS = {"white": SHAPES, "pole": SHAPES, "1/f": SHAPES.rising()}


@pytest.mark.parametrize("kind", KINDS)
def test_a_spectrum_of_theory_is_met(kind):
    wanted = in_bands(kind)
    found = KINDS[kind].fit(wanted, BANDS.counts)
    # a pole between two of the grid's, 1.9 apart in frequency, is made of both
    np.testing.assert_allclose(found.power[TOLD], wanted[TOLD], rtol=0.12)


@pytest.mark.parametrize("kind", KINDS)
def test_the_spectrum_of_a_record_is_recovered(kind):
    wanted = in_bands(kind)
    found = KINDS[kind].fit(simulated(kind, np.random.default_rng(5)), BANDS.counts)
    # of 400 coefficients and more a band alone tells 7 %; four standard deviations and the grid
    many = BANDS.counts > 300.0
    np.testing.assert_allclose(found.power[many], wanted[many], rtol=0.3)
    # noise of a thousand coefficients together is known to 4.5 %
    slow = TOLD & (BANDS.counts < 300.0)
    share = BANDS.counts[slow] / BANDS.counts[slow].sum()
    assert share @ np.log(found.power[slow] / wanted[slow]) == pytest.approx(0.0, abs=0.25)
    whole = float(BANDS.counts @ found.power), float(BANDS.counts @ wanted)
    assert whole[0] == pytest.approx(whole[1], rel=0.06)


def test_slow_noise_is_taken_only_where_it_was_accepted():
    wanted = in_bands("1/f")
    first = np.flatnonzero(TOLD)[0]
    assert SHAPES.fit(wanted, BANDS.counts).power[first] < 0.5 * wanted[first]
    assert SHAPES.rising().fit(wanted, BANDS.counts).power[first] > 0.8 * wanted[first]


def test_the_fit_is_at_least_as_likely_as_the_true_spectrum():
    power, wanted = simulated("pole", np.random.default_rng(6)), in_bands("pole")

    def nats(spectrum):
        return -0.5 * float(np.sum(BANDS.counts * (np.log(spectrum) + power / spectrum)))

    # four free shapes gain some two nats; a pole off the grid costs about as much
    assert nats(SHAPES.fit(power, BANDS.counts).power) > nats(wanted) - 4.0


def test_a_share_of_what_is_modelled_is_form_error_up_to_a_hundredth_of_its_size():
    nothing, shapes = np.zeros(len(BANDS)), SHAPES.without_bumps()
    model = np.where(np.arange(len(BANDS)) == 20, 50.0, 0.0)
    power = 1e-4 + 1e-4 * model
    bare = shapes.fit(power, BANDS.counts)
    with_form = shapes.fit(power, BANDS.counts, None, model, nothing)
    assert bare.power[20] < 0.2 * power[20]
    assert with_form.power[20] == pytest.approx(power[20], rel=0.05)
    # a hundredth in amplitude is the most
    power[20] += 9e-4 * model[20]
    capped = shapes.fit(power, BANDS.counts, None, model, nothing)
    assert capped.power[20] < 0.2 * power[20]


def test_white_noise_behind_the_filter_of_the_channel_is_no_hump():
    sections = signal.butter(2, 55.0, fs=1.0 / PERIOD_S, output="sos")
    # forward and back
    power = means(np.abs(signal.sosfreqz(sections, HERTZ, fs=1.0 / PERIOD_S)[1]) ** 4)
    off = []
    for shapes in (make_shapes(BANDS.frequency_hz, 1e-12, power), SHAPES):
        falling = shapes.without_bumps().fit(power, BANDS.counts).power
        off.append(np.abs(np.log(falling / power))[power > 0.01].max())
    # scoring ends where a step gains .02 nats; poles and powers of 1/f miss the knee
    assert off[0] < 0.02
    assert off[1] > 0.1
