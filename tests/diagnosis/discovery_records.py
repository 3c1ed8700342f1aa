"""Records of white noise on a motion in closed form, ready for the discovery."""

import numpy as np
from swinging_shaft import NOISE_NM, RIPPLE, record

from hdbench.diagnosis.discovery.baseline import parse_baseline
from hdbench.diagnosis.discovery.channel import start_fit
from hdbench.diagnosis.discovery.record import prepare_record
from hdbench.diagnosis.discovery.spectrum import Spectrum
from hdbench.model import BenchModel
from hdbench.profile import load_profile

PROFILE = load_profile("cim-tr-97-06")


def swinging(n, extra=lambda time, angle, speed: 0.0, seed=0, change=(), mean=50.0, swing=40.0):
    """Return a record at 1 kHz of a speed that swings once in 2 s, its ripple and white noise."""
    trace = record(extra, (mean, swing, 2.0), RIPPLE, n=n, seed=seed)
    model = BenchModel.from_profile(PROFILE.data)
    masked = np.zeros(n, dtype=bool)
    return prepare_record(trace, PROFILE.data, model, masked, parse_baseline(change))


def with_noise(fit, noise_nm):
    """Return a fit of the same baseline to another noise, its spectrum known: white."""
    view = fit.of(fit.bands.transform(noise_nm[:, None])[0])
    power = np.full(len(fit.bands), NOISE_NM**2)
    view.spectrum = Spectrum(power, fit.spectrum.amounts)
    view.coefficients = np.zeros_like(fit.coefficients)
    view.settle(0)
    return view


def fitted(record):
    """Return the fit of the baseline; no low-pass is sought, which takes longer than the fit."""
    return start_fit(record.behind(None))
