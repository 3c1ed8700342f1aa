"""Joint fit of baseline, causes and their form errors, in the cosine transform."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.bands import Bands
from hdbench.diagnosis.discovery.moments import (
    RISES,
    Moments,
    Solved,
    among,
    normal_equations,
    packed,
    solve,
    solve_best,
)
from hdbench.diagnosis.discovery.record import SAMPLED, Record
from hdbench.diagnosis.discovery.spectrum import Shapes, Spectrum, make_shapes
from hdbench.diagnosis.discovery.tables import Table
from hdbench.diagnosis.discovery.term import (
    Term,
    follows_motion,
    is_whole_share,
    term_columns,
)
from hdbench.diagnosis.evidence import PASSED
from hdbench.records.trace import FloatArray

# name of the columns that stand for slow motion where the channel is judged
SLOW = "slow-motion"
# directions of which less than this share of their energy is their own are taken as dependent
_OWN_SHARE = 1e-6
# a play or a limit takes all that is its own, to a hundredth: no form is exact
_WHOLE_STD = 0.01
# rows for which a fit has room before it must move: those of some causes and their form errors
_ROOM = 48


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
class Products:
    """Products of further rows in each band.

    Parameters
    ----------
    cross : ndarray, shape (n_bands, m, k)
        With the rows of a fit.
    own : ndarray, shape (n_bands, m, m)
        With each other.
    right : ndarray, shape (n_bands, m)
        With the residual.
    """

    cross: FloatArray
    own: FloatArray
    right: FloatArray

    def mixed(self, mix: FloatArray) -> Products:
        """Return the products of sums of the rows, `mix` of shape (m, n)."""
        return Products(mix.T @ self.cross, mix.T @ self.own @ mix, self.right @ mix)


@dataclass(frozen=True, slots=True)
class Beside:
    """The residual of a fit and the rows that stay free beside a candidate.

    Parameters
    ----------
    bands : Bands
        Bands.
    rows : ndarray, shape (k, size)
        Rows of the fit.
    kept : ndarray of int, shape (n_kept,)
        Those that are explained and stay.
    moments : Moments
        Their moments.
    residual : ndarray, shape (size,)
        Residual.
    spectrum : Spectrum
        Noise.
    whitening : ndarray, shape (size,)
        One over the noise's power at each coefficient.
    factor : ndarray, shape (n_kept, k)
        Inverse Cholesky factor of the information of the rows that stay, zero for the others.
    free : ndarray, shape (n_kept,)
        The factor times the right side of these: what they may still take of the residual.
    """

    bands: Bands
    rows: FloatArray
    kept: NDArray[np.int64]
    moments: Moments
    residual: FloatArray
    spectrum: Spectrum
    whitening: FloatArray
    factor: FloatArray
    free: FloatArray

    def products(self, rows: FloatArray) -> Products:
        """Return the products of further rows in each band."""
        bands = self.bands
        right = bands.along(rows, self.residual)
        return Products(bands.gram(rows, self.rows), bands.gram(rows, rows), right)

    def project(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return information and right side of further rows beside what is explained."""
        left, right, _ = self.projected(self.products(rows))
        return left, right

    def projected(self, products: Products) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the same of rows with these products, and the information on each row alone."""
        weight = 1.0 / self.spectrum.power
        cross, own = (np.tensordot(weight, one, 1) for one in (products.cross, products.own))
        cross = self.factor @ cross.T
        right = weight @ products.right - cross.T @ self.free
        left, before = own - cross.T @ cross, np.diag(own)
        # what rounding leaves of a row that is explained is nothing
        dead = np.diag(left) < _OWN_SHARE * before
        left[dead, :] = 0.0
        left[:, dead] = 0.0
        return left, np.where(dead, 0.0, right), before

    def unexplained(self, row: FloatArray) -> FloatArray:
        """Return what the rows of the fit leave of a further row."""
        cross = self.factor @ (self.rows @ (row * self.whitening))
        return np.asarray(row - (self.factor.T @ cross) @ self.rows)


class Store:
    """Rows that copies of a fit have in common: a fit that holds all of them adds in place."""

    __slots__ = ("rows", "used")

    def __init__(self, rows: FloatArray, places: NDArray[np.int64], extra: int = 0) -> None:
        self.used = len(places)
        self.rows = np.empty((self.used + extra + _ROOM, rows.shape[1]))
        np.take(rows, places, axis=0, out=self.rows[: self.used], mode="clip")

    def has_room(self, held: int, extra: int) -> bool:
        """Return whether a fit that holds so many rows may add more here."""
        return held == self.used and held + extra <= len(self.rows)

    def add(self, rows: FloatArray) -> FloatArray:
        """Add rows and return all."""
        self.rows[self.used : self.used + len(rows)] = rows
        self.used += len(rows)
        return self.rows[: self.used]


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
    against : ndarray, shape (n_bands, k)
        Products of rows with what was measured.
    power : ndarray, shape (n_bands,)
        Power of what was measured.
    coefficients : ndarray, shape (k,)
        Fitted coefficients, N m.
    spectrum : Spectrum
        Noise.
    fixed : ndarray, shape (n_bands,)
        Power of the torque that the baseline holds fixed.
    likelihood : float
        Log likelihood of the last settling, nats.
    store : Store or None
        Where the rows are, with room for more; None before any was added.
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
    against: FloatArray
    power: FloatArray
    coefficients: FloatArray
    spectrum: Spectrum
    fixed: FloatArray
    likelihood: float = -np.inf
    information: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    store: Store | None = None

    @classmethod
    def empty(
        cls,
        record: Record,
        bands: Bands,
        shapes: Shapes,
        measured: FloatArray,
        spectrum: Spectrum,
        fixed: FloatArray,
    ) -> Fit:
        """Return a fit without any part."""
        k, none = len(bands), np.zeros(0)
        index, flags = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=bool)
        rows, gram, against = np.zeros((0, bands.size)), np.zeros((k, 0, 0)), np.zeros((k, 0))
        power = bands.power(measured)
        return cls(
            record, bands, shapes, measured, [], rows, index, flags, none, gram, against, power,
            none, spectrum, fixed,
        )  # fmt: skip

    @classmethod
    def begun(cls, record: Record, bands: Bands, floor: float, known: Iterable[Term]) -> Fit:
        """Return the fit of baseline and known causes in these bands."""
        fit = cls.laid_out(record, bands, floor)
        for term in known:
            fit.add_term(term)
        fit.settle(4, anew=True)
        return fit.retimed(record.late_s, 4) if record.late_s != 0.0 else fit

    @classmethod
    def laid_out(
        cls, record: Record, bands: Bands, floor: float, start: Spectrum | None = None
    ) -> Fit:
        """Return the fit of the baseline before it is settled, in a noise if one is given."""
        measured = response_of(record, bands)
        power = bands.power(measured) / np.maximum(bands.counts, 1e-9)
        white = np.add.reduceat(bands.passed**2, bands.edges[:-1]) / np.diff(bands.edges)
        shapes = make_shapes(bands.frequency_hz, floor, white)
        # the first weights fall with frequency: a strong effect must not hide behind itself
        falling = np.maximum.accumulate(np.maximum(power, floor)[::-1])[::-1]
        spectrum = start or shapes.fit(falling, bands.counts)
        fixed = np.nan_to_num(record.fixed_nm - record.fixed_nm[record.valid].mean())
        moved = bands.power(bands.transform(fixed[:, None])[0])
        fit = cls.empty(record, bands, shapes, measured, spectrum, moved)
        # a line above the Nyquist frequency was filtered ahead of the sampling, where it was
        ahead = bands.low_pass is not None and bands.low_pass.analog
        free = np.array([ahead and one.startswith(SAMPLED) for one in record.names], dtype=bool)
        rows, scale = np.empty((len(free), bands.size)), _sizes(record.columns)
        for some, stored in ((~free, False), (free, True)):
            rows[some] = bands.transform(record.columns[:, some], measured=stored)
        rows /= scale[:, None]
        passed = np.sum(rows**2, axis=1)
        stems = [name.rpartition(":")[0] or name for name in record.names]
        for stem in dict.fromkeys(stems):
            places = [i for i, s in enumerate(stems) if s == stem]
            if float(passed[places].sum()) < PASSED * len(places) * len(record):
                continue
            variance = record.prior_nm[places] ** 2
            fit.add_rows(stem, None, rows[places], scale[places], variance)
        return fit

    # --- rows
    def add(self, name: str, columns: FloatArray) -> int:
        """Add a part that is no cause with its columns and return its index."""
        rows, scale = scaled_rows(self.bands, columns)
        return self.add_rows(name, None, rows, scale, np.full(len(rows), np.inf))

    def add_rows(
        self,
        name: str,
        term: Term | None,
        rows: FloatArray,
        scale: FloatArray,
        variance: FloatArray,
    ) -> int:
        """Add a part with its rows; `variance` is that of the prior, (N m)^2."""
        self.parts.append(Part(name, term, scale))
        cross, own = self.bands.gram(rows, self.rows), self.bands.gram(rows, rows)
        self._append(rows, cross, own, len(self.parts) - 1, variance * scale**2)
        return len(self.parts) - 1

    def add_term(self, term: Term) -> int:
        """Add a cause and return the index of its part."""
        rows, scale = term_rows(term, self.record, self.bands)
        return self.add_rows(term.name, term, rows, scale, np.full(len(rows), np.inf))

    def add_form(self, part: int, rows: FloatArray, products: Products) -> None:
        """Give a part directions in which its form may differ; rows per unit of the form scale."""
        self._append(rows, products.cross, products.own, part, np.ones(len(rows)), form=True)
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

    def _append(
        self,
        rows: FloatArray,
        cross: FloatArray,
        own: FloatArray,
        part: int,
        variance: FloatArray,
        *,
        form: bool = False,
    ) -> None:
        """Add rows with their products with those of the fit and with each other."""
        k, extra = len(self.rows), len(rows)
        gram = np.empty((len(self.bands), k + extra, k + extra))
        gram[:, :k, :k] = self.gram
        gram[:, k:, :k], gram[:, k:, k:] = cross, own
        gram[:, :k, k:] = np.swapaxes(cross, 1, 2)
        if self.store is None or not self.store.has_room(k, extra):
            self.store = Store(self.rows, np.arange(k), extra)
        self.rows, self.gram = self.store.add(rows), gram
        self.against = np.hstack([self.against, self.bands.along(rows, self.measured)])
        self.owner = np.append(self.owner, np.full(extra, part))
        self.form = np.append(self.form, np.full(extra, form))
        self.variance = np.append(self.variance, variance)
        self.coefficients = np.append(self.coefficients, np.zeros(extra))

    @property
    def residual(self) -> FloatArray:
        """Transform of what is left, shape (size,)."""
        return np.asarray(self.measured - self.coefficients @ self.rows)

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Keep only these rows; what the others explained is residual again."""
        self.store = Store(self.rows, np.flatnonzero(kept))
        self.rows = self.store.rows[: self.store.used]
        self.gram = among(self.gram, kept)
        self.against = self.against[:, kept]
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

    def reshape(self, part: int, term: Term, *, shared: bool = True) -> None:
        """Give a cause another shape; copies of this fit may share its arrays."""
        rows, scale = term_rows(term, self.record, self.bands)
        places = np.flatnonzero((self.owner == part) & ~self.form)
        linear = self.coefficients[places] / self.parts[part].scale
        if shared:
            self.store = Store(self.rows, np.arange(len(self.rows)))
            self.rows, self.gram = self.store.rows[: self.store.used], self.gram.copy()
            self.against, self.coefficients = self.against.copy(), self.coefficients.copy()
        self.rows[places] = rows
        new = self.bands.gram(rows, self.rows)
        self.gram[:, places, :] = new
        self.gram[:, :, places] = np.swapaxes(new, 1, 2)
        self.against[:, places] = self.bands.along(rows, self.measured)
        self.coefficients[places] = linear * scale
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
        variance = np.where(self.form, self.variance * scale**2, self.variance)
        whole = self.expected
        # what is smaller than rounding needs no prior
        known = (_WHOLE_STD * whole) ** 2 + self.shapes.floor
        return np.asarray(1.0 / np.where(whole > 0.0, known, variance))

    @property
    def expected(self) -> FloatArray:
        """Mean of the prior of each coefficient: 0, or the size of a play or limit."""
        found = np.zeros(len(self.owner))
        for index, part in enumerate(self.parts):
            if part.term is not None and is_whole_share(part.term.cause):
                found[self.flat(index)] = part.scale
        return found

    def moments(
        self, kept: NDArray[np.int64] | None = None, penalty: FloatArray | None = None
    ) -> Moments:
        """Return the moments of the active rows, or of these, about what they leave.

        What rows that are not kept explained is residual again. `penalty` is another prior.
        """
        kept = np.flatnonzero(self.active) if kept is None else kept
        penalty = self.penalty if penalty is None else penalty
        coefficients = np.zeros(len(self.owner))
        coefficients[kept] = self.coefficients[kept]
        right = self.against - self.gram @ coefficients
        moving = np.array([part.moving for part in self.parts], dtype=bool)[self.owner]
        return Moments(
            packed(self.gram, kept),
            right[:, kept],
            self.power - (self.against + right) @ coefficients,
            self.bands.counts,
            coefficients[kept],
            penalty[kept],
            self.expected[kept],
            moving[kept],
            self.fixed,
        )

    def weighted(self) -> FloatArray:
        """Return the products of all rows with each other, weighed by the noise."""
        return np.asarray(np.tensordot(1.0 / self.spectrum.power, self.gram, 1))

    def settle(self, rounds: int = 2, *, anew: bool = False) -> None:
        """Fit coefficients and noise in turn."""
        idle = ~self.active & (self.coefficients != 0.0)
        if idle.any():
            self.coefficients = np.where(idle, 0.0, self.coefficients)
        if anew:
            self.take(solve(self.moments(), self.shapes, self.spectrum, rounds=rounds, anew=True))
        else:
            self.take(solve_best(self.moments(), self.shapes, self.spectrum, rounds=rounds))

    def take(self, solved: Solved) -> None:
        """Take over a solution for the active rows."""
        active = self.active
        self.coefficients = self.coefficients.copy()
        self.coefficients[active] += solved.step
        self.spectrum, self.likelihood = solved.spectrum, solved.likelihood
        self.information = np.zeros((len(active), len(active)))
        self.information[np.ix_(active, active)] = solved.information

    def flat_view(self) -> Fit | None:
        """Return the fit in a noise that does not rise towards 0 Hz; None where it does not now."""
        even = self.shapes.even(self.spectrum.power)
        if float(np.max(self.spectrum.power / even)) < RISES:
            return None
        view = replace(self)
        view.spectrum = self.shapes.fit(even, self.bands.counts)
        view.take(solve(view.moments(), view.shapes, view.spectrum, rounds=0))
        return view

    def _early(self, late_s: float) -> Fit:
        """Return the fit to the torque as it would have been read in time."""
        early = self.of(self._moved(self._read, -late_s) - self._still)
        early.settle(0)
        return early

    def likelihood_of(self, late_s: float) -> float:
        """Return the log likelihood of a delay, nats.

        The noise counts as it was read, else a tone in it would say when.
        """
        early = self._early(late_s)
        noise = self.bands.power(self._moved(early.residual, late_s))
        moments = replace(early.moments(), power=noise)
        return solve_best(moments, self.shapes, self.spectrum, rounds=1).likelihood

    def retimed(self, late_s: float, rounds: int = 1) -> Fit:
        """Return the fit of the torque as it was read so much after the motion."""
        early = self._early(late_s)
        # what is explained moves, and the noise does not
        explained = early.measured - early.residual
        new = self.of(self._read - self._moved(explained + self._still, late_s) + explained)
        new.settle(rounds)
        late = tuple(replace(one, late_s=late_s) for one in self.pieces)
        records = late if self.record.records else ()
        new.record = replace(self.record, late_s=late_s, records=records)
        return new

    @property
    def pieces(self) -> tuple[Record, ...]:
        """The records of a stack; a plain one alone."""
        return self.record.records or (self.record,)

    @property
    def _parts_of_bands(self) -> tuple[Bands, ...]:
        return getattr(self.bands, "parts", (self.bands,))

    @property
    def _still(self) -> FloatArray:
        pairs = zip(self.pieces, self._parts_of_bands, strict=True)
        return np.concatenate([fixed_of(one, own) for one, own in pairs])

    @property
    def _read(self) -> FloatArray:
        pairs = zip(self.pieces, self._parts_of_bands, strict=True)
        return np.concatenate([torque_of(one, own) for one, own in pairs])

    def _moved(self, row: FloatArray, by_s: float) -> FloatArray:
        """Return what all records hold as it was so much earlier, each by its own samples."""
        ends = np.cumsum([own.size for own in self._parts_of_bands])[:-1]
        some = zip(self.pieces, self._parts_of_bands, np.split(row, ends), strict=True)
        return np.concatenate([own.moved(x, by_s / one.period_s) for one, own, x in some])

    def of(self, measured: FloatArray) -> Fit:
        """Return a fit with the same parts and coefficients of another measurement."""
        new = self.copy()
        new.measured, new.power = measured, self.bands.power(measured)
        new.against = self.bands.along(self.rows, measured)
        return new

    def without_view(self, part: int) -> Fit:
        """Return the fit without one part, in the same noise."""
        view = self.copy()
        view.remove(part)
        view.take(solve(view.moments(), view.shapes, view.spectrum, rounds=0))
        return view

    def beside(self, *without: int) -> Beside:
        """Return residual and rows for a candidate, without these parts."""
        gone = np.isin(self.owner, without)
        kept = np.flatnonzero(self.active & ~gone)
        moments = self.moments(kept)
        normal, right = normal_equations(moments, self.spectrum)
        # rows that do not stay have no part in the factor: so none of them is copied
        factor = np.zeros((len(kept), len(gone)))
        factor[:, kept] = np.linalg.inv(normal.factor) * normal.scale
        return Beside(
            self.bands,
            self.rows,
            kept,
            moments,
            self.measured - np.where(gone, 0.0, self.coefficients) @ self.rows,
            self.spectrum,
            self.bands.spread(1.0 / self.spectrum.power),
            factor,
            factor[:, kept] @ right,
        )

    # --- what the fit says
    def causes(self) -> list[int]:
        """Return the parts that are causes and were not known before."""
        return [i for i, p in enumerate(self.parts) if p.term is not None and not p.term.known]

    def tables(self) -> list[int]:
        """Return the parts that are tables without a name."""
        terms = [part.term for part in self.parts]
        return [i for i, term in enumerate(terms) if term and isinstance(term.cause, Table)]

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
        return replace(self, parts=[replace(part) for part in self.parts])


def fitted_nm(fit: Fit, *, whole: bool = True) -> FloatArray:
    """Return the fitted torque, N m; without what acts on the whole signal where asked."""
    record = fit.record
    torque = np.zeros(len(record))
    for index, part in enumerate(fit.parts):
        if part.term is not None:
            if whole or not part.term.cause.whole_signal:
                torque += term_columns(part.term, record) @ fit.linear(index)
        elif len(part.scale):
            places = [
                i for i, n in enumerate(record.names) if (n.rpartition(":")[0] or n) == part.name
            ]
            torque += record.columns[:, places] @ fit.linear(index)
    return torque


def response_of(record: Record, bands: Bands) -> FloatArray:
    """Return the transform of the torque less the fixed one, both at the times of the torque."""
    return np.asarray(torque_of(record, bands) - fixed_of(record, bands))


def torque_of(record: Record, bands: Bands) -> FloatArray:
    """Return the transform of the measured torque."""
    torque = np.where(record.valid, record.torque_nm, 0.0)
    key = ("torque", bands.low_pass, bands.size)
    return record.remembered(key, lambda: bands.transform(torque[:, None], measured=True)[0])


def fixed_of(record: Record, bands: Bands) -> FloatArray:
    """Return the transform of what the channel makes of the fixed torque."""
    return record.remembered(
        ("fixed", bands.low_pass, bands.size), lambda: _fixed_of(record, bands)
    )


def _fixed_of(record: Record, bands: Bands) -> FloatArray:
    rows = bands.transform(record.ahead_nm[:, None])
    if record.logged_nm is not None and record.motion.load_torque_nm is not None:
        rows = rows + bands.transform(np.nan_to_num(record.logged_nm)[:, None], measured=True)
    return np.asarray(rows[0])


def scaled_rows(bands: Bands, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the transform of columns divided by their root mean square, and that."""
    scale = _sizes(columns)
    return bands.transform(columns) / scale[:, None], scale


def term_rows(term: Term, record: Record, bands: Bands) -> tuple[FloatArray, FloatArray]:
    """Return the same of the columns of a term, which are asked for again and again."""
    key = (term.name, term.cause.columns, *term.shape.items())
    scale = record.remembered(("scale", *key), lambda: _sizes(term_columns(term, record)))
    rows = record.remembered(
        (bands.low_pass, bands.size, *key),
        lambda: bands.transform(term_columns(term, record)) / scale[:, None],
    )
    return rows, scale


def _sizes(columns: FloatArray) -> FloatArray:
    """Return the root mean square of columns, 1 for empty ones."""
    size = np.sqrt(np.einsum("nk,nk->k", columns, columns) / len(columns))
    return np.where(size > 0.0, size, 1.0)
