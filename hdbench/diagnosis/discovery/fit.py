"""Joint fit of baseline, causes and their form errors, in the cosine transform."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.bands import Bands, LowPass, make_bands
from hdbench.diagnosis.discovery.moments import (
    RISES,
    Moments,
    Solved,
    inverse_scale,
    solve,
    solve_best,
)
from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.spectrum import Shapes, Spectrum, make_shapes
from hdbench.diagnosis.discovery.tables import is_table
from hdbench.diagnosis.discovery.term import Term, follows_motion, term_columns
from hdbench.diagnosis.evidence import PASSED
from hdbench.records.trace import FloatArray

# no torque is known better than to this share of its scatter
_FLOOR = 1e-3
# below this share of its scatter a torque that was filtered before it was stored holds nothing but
# the tail of the filter, which no model follows
_FILTERED_FLOOR = 2e-2
# a band with less than this many times the floor is empty
_EMPTY = 10.0
# corners of a low-pass that is tried where the torque has no power above some 0.3 of Nyquist,
# relative to the last frequency with power
_NARROW = 0.3
_CORNERS = (0.3, 0.45, 0.6, 0.8, 1.1, 1.5)
# noise that falls below this share between this part of the band and its end may be low-passed
# too; in a record of less than so many samples that costs little to try
_FALLS, _FLAT, _SHORT = 0.3, 0.15, 40_000
# corners that are tried then, relative to Nyquist, the highest, and ratios about the best
_WIDE_CORNERS = (0.015, 0.04, 0.1, 0.2, 0.4, 0.75)
_HIGHEST, _FINER = 0.95, (1.4, 1.2, 1.1, 1.05, 1.02)
# order of a low-pass, and whether it has a delay
_KINDS = ((2, False), (2, True), (4, False))
# dry friction turns over within a hundredth of the largest speed
_SHARP = 100.0
# name of the columns that stand for slow motion where the channel is judged
SLOW = "slow-motion"
# a low-pass is one of eighteen that are tried, and is seldom: 60 to 1
LOW_PASS_PRICE = 7.0
# directions of which less than this share of their energy is their own are taken as dependent
_OWN_SHARE = 1e-6


@dataclass(slots=True)
class Part:
    """What one cause or one piece of the baseline has in the fit.

    Parameters
    ----------
    name : str
        Name of the cause, or of the baseline's piece.
    term : Term or None
        Cause with its shape; None for the baseline.
    scale : ndarray
        Root mean square of each column, N m per unit, by which its row was divided.
    form_scale : float
        Standard deviation of the form error relative to the part's own size; 0 without one.
    form_size_nm : float
        Size of the part for which the rows of its form error were made; 0 where none are.
    false_alarm : float
        Probability of such a look on this record without an effect, when it was accepted.
    trials : float
        Places that were tried then.
    cost_nats : float
        What its parameters, shape and place cost then.
    """

    name: str
    term: Term | None
    scale: FloatArray
    form_scale: float = 0.0
    form_size_nm: float = 0.0
    false_alarm: float = 1.0
    trials: float = 1.0
    cost_nats: float = 0.0

    @property
    def moving(self) -> bool:
        """Whether it follows the motion, so that a delay between channels spoils it."""
        return self.name == SLOW or (self.term is not None and follows_motion(self.term.cause))


@dataclass(frozen=True, slots=True)
class Beside:
    """The residual of a fit and the rows that stay free beside a candidate.

    Parameters
    ----------
    bands : Bands
        Bands.
    rows : ndarray, shape (k, size)
        Rows of what is explained.
    moments : Moments
        Their moments.
    residual : ndarray, shape (size,)
        Residual.
    spectrum : Spectrum
        Noise.
    whitening : ndarray, shape (size,)
        One over the noise's power at each coefficient.
    factor : ndarray, shape (k, k)
        Inverse Cholesky factor of the information of `rows`.
    free : ndarray, shape (k,)
        The factor times the right side of `rows`: what they may still take of the residual.
    """

    bands: Bands
    rows: FloatArray
    moments: Moments
    residual: FloatArray
    spectrum: Spectrum
    whitening: FloatArray
    factor: FloatArray
    free: FloatArray

    def project(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return information and right side of further rows beside what is explained."""
        white = rows * self.whitening
        cross = self.factor @ (self.rows @ white.T)
        own = white @ rows.T
        right = white @ self.residual
        right = right - cross.T @ self.free
        left = own - cross.T @ cross
        # what rounding leaves of a row that is explained is nothing
        dead = np.diag(left) < _OWN_SHARE * np.diag(own)
        left[dead, :] = 0.0
        left[:, dead] = 0.0
        right = np.where(dead, 0.0, right)
        return left, right


@dataclass(slots=True)
class Fit:
    """State of the joint fit.

    Parameters
    ----------
    record : Record
        Record.
    bands : Bands
        Bands.
    shapes : Shapes
        Shapes of the noise's spectrum.
    measured : ndarray, shape (size,)
        Transform of the response.
    parts : list of Part
        Baseline pieces, then causes in the order of their acceptance.
    rows : ndarray, shape (k, size)
        Rows of all parts.
    owner : ndarray of int, shape (k,)
        Index of the part of each row.
    form : ndarray of bool, shape (k,)
        Whether a row is a direction of form error.
    variance : ndarray, shape (k,)
        Prior variance of each coefficient, (N m)^2; infinite where free; of a form direction per
        unit of the squared form scale.
    gram : ndarray, shape (n_bands, k, k)
        Products of rows in each band.
    coefficients : ndarray, shape (k,)
        Fitted coefficients, N m.
    residual : ndarray, shape (size,)
        Transform of what is left.
    spectrum : Spectrum
        Noise.
    fixed : ndarray, shape (n_bands,)
        Power of the torque that the baseline holds fixed.
    likelihood : float
        Log likelihood of the last settling, nats.
    """

    record: Record
    bands: Bands
    shapes: Shapes
    measured: FloatArray
    parts: list[Part]
    rows: FloatArray
    owner: NDArray[np.int64]
    form: NDArray[np.bool_]
    variance: FloatArray
    gram: FloatArray
    coefficients: FloatArray
    residual: FloatArray
    spectrum: Spectrum
    fixed: FloatArray
    likelihood: float = -np.inf
    information: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def start(cls, record: Record, known: Iterable[Term] = ()) -> Fit:
        """Return the fit of the baseline and the causes that the model already holds."""
        bands = make_bands(record.valid, record.period_s)
        measured = _response(record, bands)
        floor = (_FLOOR * float(np.std(record.response_nm[record.valid])) + 1e-12) ** 2
        power = bands.power(measured) / np.maximum(bands.counts, 1e-9)
        top = int(np.flatnonzero(power > _EMPTY * floor).max(initial=3))
        last = bands.frequency_hz[top] / bands.frequency_hz[-1]
        corners: Sequence[float] = _WIDE_CORNERS
        if last < _NARROW:
            floor *= (_FILTERED_FLOOR / _FLOOR) ** 2
            top = int(np.flatnonzero(power > _EMPTY * floor).max(initial=3))
            corners = [
                share * bands.frequency_hz[top] / bands.frequency_hz[-1] for share in _CORNERS
            ]
            share = bands.edges[top + 1] / bands.length
            bands = make_bands(record.valid, record.period_s, float(share))
        fit = cls.begun(record, bands.low_passed(record.low_pass), floor, known)
        if record.channel_known or (corners is _WIDE_CORNERS and _is_open(fit)):
            return fit
        low_pass = _channel(record, bands, floor, corners)
        if low_pass is None:
            return fit
        return cls.begun(record.behind(low_pass), bands.low_passed(low_pass), floor, known)

    @classmethod
    def begun(cls, record: Record, bands: Bands, floor: float, known: Iterable[Term]) -> Fit:
        """Return the fit of baseline and known causes in these bands."""
        measured = _response(record, bands)
        power = bands.power(measured) / np.maximum(bands.counts, 1e-9)
        shapes = make_shapes(bands.frequency_hz, floor)
        # the first weights fall with frequency: a strong effect must not hide behind itself
        falling = np.maximum.accumulate(np.maximum(power, floor)[::-1])[::-1]
        spectrum = shapes.fit(falling, bands.counts)
        k = len(bands)
        fixed = np.where(record.valid, record.fixed_nm, 0.0)
        fixed = fixed - fixed[record.valid].mean()
        fit = cls(
            record,
            bands,
            shapes,
            measured,
            [],
            np.zeros((0, bands.size)),
            np.zeros(0, dtype=np.int64),
            np.zeros(0, dtype=bool),
            np.zeros(0),
            np.zeros((k, 0, 0)),
            np.zeros(0),
            measured.copy(),
            spectrum,
            bands.power(bands.transform(fixed[:, None])[0]),
        )
        stems = [name.rpartition(":")[0] or name for name in record.names]
        for stem in dict.fromkeys(stems):
            places = [i for i, s in enumerate(stems) if s == stem]
            prior = record.prior_nm[places]
            passed = scaled_rows(bands, record.columns[:, places])[0]
            if float(np.sum(passed**2)) < PASSED * len(places) * len(record):
                continue
            fit.add(stem, None, record.columns[:, places], prior**2)
        for term in known:
            fit.add_term(term)
        fit.settle(4, anew=True)
        return fit

    # --- rows
    def add(
        self, name: str, term: Term | None, columns: FloatArray, variance: FloatArray | None = None
    ) -> int:
        """Add a part with its columns and return its index."""
        rows, scale = scaled_rows(self.bands, columns)
        self.parts.append(Part(name, term, scale))
        free = np.full(len(rows), np.inf) if variance is None else variance * scale**2
        self._append(rows, len(self.parts) - 1, False, free)
        return len(self.parts) - 1

    def add_term(self, term: Term) -> int:
        """Add a cause and return the index of its part."""
        return self.add(term.name, term, term_columns(term, self.record))

    def add_form(self, part: int, rows: FloatArray) -> None:
        """Give a part directions in which its form may differ; rows per unit of the form scale."""
        self._append(rows, part, True, np.ones(len(rows)))
        self.parts[part].form_size_nm = self.size_nm(part)

    def rescale_forms(self) -> None:
        """Let the form errors follow the sizes of their parts."""
        ratio = np.ones(len(self.owner))
        for index, part in enumerate(self.parts):
            size = self.size_nm(index)
            if part.form_size_nm > 0.0 and size > 0.0:
                ratio[self.form & (self.owner == index)] = size / part.form_size_nm
                part.form_size_nm = size
        # only the prior of the coefficients changes: the rows stay
        self.variance = self.variance * ratio**2

    def _append(self, rows: FloatArray, part: int, form: bool, variance: FloatArray) -> None:
        k, extra = len(self.rows), len(rows)
        every = np.concatenate([self.rows, rows])
        new = self.bands.gram(rows, every)
        gram = np.empty((len(self.bands), k + extra, k + extra))
        gram[:, :k, :k] = self.gram
        gram[:, k:, :] = new
        gram[:, :k, k:] = np.swapaxes(new[:, :, :k], 1, 2)
        self.rows, self.gram = every, gram
        self.owner = np.append(self.owner, np.full(extra, part))
        self.form = np.append(self.form, np.full(extra, form))
        self.variance = np.append(self.variance, variance)
        self.coefficients = np.append(self.coefficients, np.zeros(extra))

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Keep only these rows; what the others explained is residual again."""
        self.residual = self.residual + self.coefficients[~kept] @ self.rows[~kept]
        self.rows = self.rows[kept]
        self.gram = self.gram[:, kept][:, :, kept]
        self.owner, self.form = self.owner[kept], self.form[kept]
        self.variance, self.coefficients = self.variance[kept], self.coefficients[kept]

    def remove(self, part: int) -> None:
        """Take a part out, with its form error."""
        self.keep(self.owner != part)
        self.parts.pop(part)
        self.owner = np.where(self.owner > part, self.owner - 1, self.owner)

    def without(self, *parts: int) -> Fit:
        """Return a fit of its own without these parts."""
        new = self.copy()
        for part in sorted(parts, reverse=True):
            new.remove(part)
        new.settle(2)
        return new

    def reshape(self, part: int, term: Term) -> None:
        """Give a cause another shape."""
        rows, scale = scaled_rows(self.bands, term_columns(term, self.record))
        places = np.flatnonzero((self.owner == part) & ~self.form)
        linear = self.coefficients[places] / self.parts[part].scale
        self.residual = self.residual + self.coefficients[places] @ self.rows[places]
        self.rows[places] = rows
        new = self.bands.gram(rows, self.rows)
        self.gram[:, places, :] = new
        self.gram[:, :, places] = np.swapaxes(new, 1, 2)
        self.coefficients[places] = linear * scale
        self.residual = self.residual - self.coefficients[places] @ rows
        self.parts[part].term, self.parts[part].scale = term, scale

    # --- algebra
    @property
    def active(self) -> NDArray[np.bool_]:
        """Rows that take part: all but the form errors of scale zero."""
        scale = np.array([part.form_scale for part in self.parts])[self.owner]
        return ~self.form | (scale > 0.0)

    @property
    def penalty(self) -> FloatArray:
        """One over the prior variance of each coefficient."""
        scale = np.array([part.form_scale for part in self.parts])[self.owner]
        scale = np.where(scale > 0.0, scale, 1.0)
        return np.asarray(1.0 / np.where(self.form, self.variance * scale**2, self.variance))

    def moments(self) -> Moments:
        """Return the moments of the active rows about the present residual."""
        return self.all_moments().without(~self.active)

    def all_moments(self) -> Moments:
        """Return the moments of all rows, form errors of scale zero among them."""
        edges = self.bands.edges[:-1]
        right = np.empty((len(self.bands), len(self.rows)))
        for k, row in enumerate(self.rows):
            right[:, k] = np.add.reduceat(row * self.residual, edges)
        power = self.bands.power(self.residual)
        moving = np.array([part.moving for part in self.parts], dtype=bool)[self.owner]
        return Moments(
            self.gram,
            right,
            power,
            self.bands.counts,
            self.coefficients,
            self.penalty,
            moving,
            self.fixed,
        )

    def settle(self, rounds: int = 2, *, anew: bool = False) -> None:
        """Fit coefficients and noise in turn."""
        idle = ~self.active & (self.coefficients != 0.0)
        if idle.any():
            self.residual = self.residual + self.coefficients[idle] @ self.rows[idle]
            self.coefficients[idle] = 0.0
        if anew:
            self.take(solve(self.moments(), self.shapes, self.spectrum, rounds=rounds, anew=True))
        else:
            self.take(solve_best(self.moments(), self.shapes, self.spectrum, rounds=rounds))

    def take(self, solved: Solved) -> None:
        """Take over a solution for the active rows."""
        active = self.active
        self.coefficients[active] += solved.step
        self.residual = self.residual - solved.step @ self.rows[active]
        self.spectrum, self.likelihood = solved.spectrum, solved.likelihood
        self.information = np.zeros((len(active), len(active)))
        self.information[np.ix_(active, active)] = solved.information

    def flat_view(self) -> Fit | None:
        """Return the fit in a noise that does not rise towards 0 Hz; None where it does not now."""
        even = self.shapes.even(self.spectrum.power)
        if float(np.max(self.spectrum.power / even)) < RISES:
            return None
        view = replace(self, coefficients=self.coefficients.copy())
        view.spectrum = self.shapes.fit(even, self.bands.counts)
        view.take(solve(view.moments(), view.shapes, view.spectrum, rounds=0))
        return view

    def without_view(self, part: int) -> Fit:
        """Return the fit without one part, in the same noise."""
        view = self.copy()
        view.remove(part)
        view.take(solve(view.moments(), view.shapes, view.spectrum, rounds=0))
        return view

    def beside(self, *without: int) -> Beside:
        """Return residual and rows for a candidate, without these parts."""
        moments, residual, kept = self.all_moments(), self.residual, self.active
        if without:
            out = np.isin(self.owner, without)
            residual = residual + self.coefficients[out] @ self.rows[out]
            kept = kept & ~out
        moments, rows = moments.without(~kept), self.rows[kept]
        weight = 1.0 / self.spectrum.power
        k = len(rows)
        matrix = (weight @ moments.gram.reshape(len(weight), -1)).reshape(k, k)
        matrix[np.diag_indices_from(matrix)] += moments.penalty
        scale = inverse_scale(np.diag(matrix))
        scaled = matrix * np.outer(scale, scale)
        scaled[np.diag_indices_from(scaled)] += np.where(scale > 0.0, 1e-10, 1.0)
        factor = np.linalg.inv(np.linalg.cholesky(scaled)) * scale[None, :]
        right = weight @ moments.right - moments.penalty * moments.coefficients
        return Beside(
            self.bands,
            rows,
            moments,
            residual,
            self.spectrum,
            self.bands.spread(weight),
            factor,
            factor @ right,
        )

    # --- what the fit says
    def causes(self) -> list[int]:
        """Return the parts that are causes and were not known before."""
        return [i for i, p in enumerate(self.parts) if p.term is not None and not p.term.known]

    def tables(self) -> list[int]:
        """Return the parts that are tables without a name."""
        terms = [part.term for part in self.parts]
        return [i for i, term in enumerate(terms) if term is not None and is_table(term.cause)]

    def term(self, part: int) -> Term:
        """Return the cause of a part, with its shape; ValueError for a piece of the baseline."""
        term = self.parts[part].term
        if term is None:
            raise ValueError(f"{self.parts[part].name} is a piece of the baseline, no cause")
        return term

    def flat(self, part: int) -> NDArray[np.int64]:
        """Return the rows of a part without its form error."""
        return np.flatnonzero((self.owner == part) & ~self.form)

    def linear(self, part: int) -> FloatArray:
        """Return the linear parameters of a part."""
        return np.asarray(self.coefficients[self.flat(part)] / self.parts[part].scale)

    def size_nm(self, part: int) -> float:
        """Return the root mean square of a part's torque, N m."""
        row = self.coefficients[self.flat(part)] @ self.rows[self.flat(part)]
        return float(np.sqrt(np.mean(row**2)))

    def copy(self) -> Fit:
        """Return a fit that can be changed without this one."""
        return replace(
            self,
            parts=[replace(part) for part in self.parts],
            rows=self.rows.copy(),
            gram=self.gram.copy(),
        )


def _is_open(fit: Fit) -> bool:
    """Return whether the noise of a long record goes on to the end of the band."""
    bands = fit.bands
    left = bands.power(fit.residual) / np.maximum(bands.counts, 1e-9)
    share = bands.frequency_hz / bands.frequency_hz[-1]
    last = np.median(left[share > 1.0 - _FLAT])
    return bool(len(fit.record) > _SHORT and last > _FALLS * left[np.searchsorted(share, _FLAT)])


def _response(record: Record, bands: Bands) -> FloatArray:
    """Return the transform of the torque less what the channel makes of the fixed one."""
    torque, fixed = (np.where(record.valid, x, 0.0) for x in (record.torque_nm, record.fixed_nm))
    measured = bands.transform(torque[:, None], measured=True)[0]
    return np.asarray(measured - bands.transform(fixed[:, None])[0])


def _channel(
    record: Record, bands: Bands, floor: float, corners: Sequence[float]
) -> LowPass | None:
    """Return the low-pass that a torque channel most likely has; None for none.

    Motion is explained by dry and viscous friction and an inertia, so that its own spectrum is not
    taken for the channel's.
    """
    motion = record.motion
    speed = np.where(record.valid, motion.velocity_rad_s, 0.0)
    largest = max(float(np.abs(speed).max()), 1e-12)
    acceleration = np.where(record.valid, motion.acceleration_rad_s2, 0.0)
    slow = np.column_stack([speed, np.tanh(_SHARP * speed / largest), acceleration])

    def value(low_pass: LowPass | None) -> float:
        fit = Fit.begun(record.behind(low_pass), bands.low_passed(low_pass), floor, ())
        fit.add(SLOW, None, slow)
        fit.settle(5)
        return fit.likelihood - (0.0 if low_pass is None else LOW_PASS_PRICE)

    none = value(None)
    tried = [LowPass(min(c, _HIGHEST), order, causal) for c in corners for order, causal in _KINDS]
    best = max((value(one), place) for place, one in enumerate(tried))
    likelihood, found = best[0], tried[best[1]]
    if record.load != 0.0:
        other = replace(found, load=True)
        likelihood, found = max((likelihood, found), (value(other), other), key=lambda x: x[0])
    for ratio in _FINER:
        for factor in (ratio, 1.0 / ratio):
            other = replace(found, corner=min(factor * found.corner, _HIGHEST))
            gained = value(other)
            if gained > likelihood:
                likelihood, found = gained, other
                break
    return found if likelihood > none else None


def scaled_rows(bands: Bands, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the transform of columns divided by their root mean square, and that."""
    scale = np.sqrt(np.mean(columns**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    return bands.transform(columns / scale), scale
