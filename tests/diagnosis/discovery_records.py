"""Records of white noise on a motion in closed form, ready for the discovery."""

import numpy as np
from swinging_shaft import NOISE_NM, RIPPLE, record

from hdbench.diagnosis.discovery.baseline import parse_baseline
from hdbench.diagnosis.discovery.channel import start_fit
from hdbench.diagnosis.discovery.record import prepare_record
from hdbench.diagnosis.discovery.spectrum import Spectrum
from hdbench.diagnosis.discovery.term import Term
from hdbench.model import BenchModel, catalogue
from hdbench.profile import load_profile

PROFILE = load_profile("cim-tr-97-06")
MODEL = BenchModel.from_profile(PROFILE.data)


def prepared(trace, change=(), masked=None):
    """Return the record of a trace of which no sample is masked, or those given."""
    masked = np.zeros(len(trace), dtype=bool) if masked is None else masked
    return prepare_record(trace, PROFILE.data, MODEL, masked, parse_baseline(change))


def swinging(n, extra=lambda time, angle, speed: 0.0, seed=0, change=(), mean=50.0, swing=40.0):
    """Return a record at 1 kHz of a speed that swings once in 2 s, its ripple and white noise."""
    return prepared(record(extra, (mean, swing, 2.0), RIPPLE, n=n, seed=seed), change)


def term(name, **shape):
    """Return a cause of the catalogue with its shape."""
    return Term(catalogue()[name], shape)


def with_terms(fit, *terms, rounds=3):
    """Add terms to a fit and settle it; return it and the part of the last one."""
    for one in terms:
        part = fit.add_term(one)
    fit.settle(rounds)
    return fit, part


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
