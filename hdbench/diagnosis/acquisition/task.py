"""What a diagnosis of a trace works on: its task, and the record without doubtful samples."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.acquisition.acquire import Inspected
from hdbench.diagnosis.acquisition.codes import find_comb
from hdbench.diagnosis.acquisition.known import of_the_torque
from hdbench.diagnosis.acquisition.named import Acquired
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.baselineterms import BaselineChange
from hdbench.diagnosis.measured.preflight import Preflight, find_spikes, flag_samples
from hdbench.diagnosis.measured.record import Record, mask_samples, prepare_record
from hdbench.diagnosis.measured.resolved import unresolved_motion
from hdbench.model import BenchModel, Cause, CauseTerm, catalogue, cause_named
from hdbench.profile import Profile
from hdbench.records.trace import Trace

__all__ = ["Clean", "Task", "cleaned", "task_of", "unfit", "with_terms"]

# fewer usable samples than this per baseline coefficient fit nothing that could be trusted
_SAMPLES_PER_COEFFICIENT = 20
# neighbours of a channel with coarse steps differ by one step, two where the torque moves
_STEPS = 2.5
_SPIKE_WINDOW = 5
# names that models and plans know; this search has nameless curves and lines in their place
_NOT_SEARCHED = ("asymmetric-friction", "cogging", "transmission-error")


@dataclass(frozen=True, slots=True)
class Task:
    """What a diagnosis is to do.

    Parameters
    ----------
    profile : Profile
        Bench.
    given : BenchModel
        Model that is held against the record.
    causes : tuple of Cause
        Every cause that may be named.
    alpha : float
        False-alarm rate of the record, in (0, 1).
    change : BaselineChange
        What is added to the baseline and taken out of it.
    """

    profile: Profile
    given: BenchModel
    causes: tuple[Cause, ...]
    alpha: float
    change: BaselineChange = field(default_factory=BaselineChange)

    def prepare(self, trace: Trace, masked: NDArray[np.bool_]) -> Record:
        """Return the record of a trace without the marked samples."""
        return prepare_record(trace, self.profile.data, self.given, masked, change=self.change)

    def held_terms(self) -> tuple[CauseTerm, ...]:
        """Return the causes of the model at hand that are no torque."""
        return tuple(t for t in self.given.causes if not of_the_torque(self._cause(t)))

    def of_the_torque(self) -> BenchModel:
        """Return the model at hand without causes that are no torque: they are taken out."""
        held = tuple(t for t in self.given.causes if of_the_torque(self._cause(t)))
        return replace(self.given, causes=held)

    def known_terms(self) -> tuple[Term, ...]:
        """Return the causes of the model at hand that a fit can hold."""
        terms = (Term(self._cause(t), dict(t.shape), True) for t in self.given.causes)
        return tuple(term for term in terms if of_the_torque(term.cause))

    def _cause(self, term: CauseTerm) -> Cause:
        return cause_named(term.name, where="model", extra=self.given.extra_causes)


def task_of(
    profile: Profile, model: BenchModel | None, causes: tuple[Cause, ...], alpha: float
) -> Task:
    """Return the task of a diagnosis.

    Parameters
    ----------
    profile : Profile
        Bench.
    model : BenchModel or None
        Model to hold against the record; the profile's where None.
    causes : tuple of Cause
        Causes beside the catalogue and the model's own.
    alpha : float
        False-alarm rate of the record, in (0, 1).

    Returns
    -------
    Task
        Its model knows the further causes, so that the extended model can hold them.

    Raises
    ------
    DataError
        If two causes have one name and differ.
    """
    given = model or BenchModel.from_profile(profile.data)
    own = {cause.name: cause.definition for cause in given.extra_causes}
    further = tuple(
        cause
        for cause in causes
        if cause.name not in own or cause.definition is None or cause.definition != own[cause.name]
    )
    given = replace(given, extra_causes=(*given.extra_causes, *further))
    known = catalogue(given.extra_causes).values()
    return Task(profile, given, tuple(c for c in known if c.name not in _NOT_SEARCHED), alpha)


@dataclass(frozen=True, slots=True)
class Clean:
    """A record without doubtful samples.

    Parameters
    ----------
    inspected : Inspected
        Trace after inspection.
    record : Record
        Record without masked samples, unresolved motion and spikes.
    preflight : Preflight
        Flags and masked samples, spikes among them.
    spikes : ndarray of bool, shape (n,)
        Spikes of the torque.
    unresolved : ndarray of bool, shape (n,)
        Samples whose acceleration the measured motion does not resolve.
    """

    inspected: Inspected
    record: Record
    preflight: Preflight
    spikes: NDArray[np.bool_]
    unresolved: NDArray[np.bool_]

    def above_steps(self, spikes: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return those spikes that a channel with coarse steps does not make by itself."""
        from scipy.ndimage import median_filter

        torque = self.record.torque_nm
        comb = find_comb(torque) if spikes.any() else None
        if comb is None:
            return spikes
        known = np.where(np.isfinite(torque), torque, 0.0)
        away = np.abs(known - median_filter(known, size=_SPIKE_WINDOW, mode="nearest"))
        return np.asarray(spikes & (away > _STEPS * comb.step_nm))

    def without(self, spikes: NDArray[np.bool_]) -> Clean:
        """Return it without further spikes."""
        if not spikes.any():
            return self
        every = self.spikes | spikes
        others = [flag for flag in self.preflight.flags if flag.name != "spikes" or flag.detail]
        time = self.record.motion.time_s
        flags = (*others, *flag_samples("spikes", time, every))
        preflight = Preflight(flags, self.preflight.masked | spikes)
        record = mask_samples(self.record, spikes)
        return replace(self, record=record, preflight=preflight, spikes=every)

    def restored(self, explained: NDArray[np.bool_]) -> Clean:
        """Return it with fewer spikes: those that the causes explain are none."""
        if not explained.any():
            return self
        left = self.spikes & ~explained
        others = [flag for flag in self.preflight.flags if flag.name != "spikes" or flag.detail]
        flags = (*others, *flag_samples("spikes", self.record.motion.time_s, left))
        return replace(self, preflight=replace(self.preflight, flags=flags), spikes=left)

    def flagged(self, acquired: list[Acquired]) -> Preflight:
        """Return the preflight with the flags of named faults."""
        flags = (*self.preflight.flags, *(flag for one in acquired for flag in one.flags))
        return Preflight(tuple(sorted(flags, key=lambda f: f.from_s)), self.preflight.masked)


def cleaned(task: Task, inspected: Inspected, settings: dict[str, object]) -> Clean:
    """Return the record without unresolved motion and spikes.

    Parameters
    ----------
    task : Task
        Task.
    inspected : Inspected
        Trace after inspection.
    settings : dict
        Gets the number of samples whose motion is not resolved.

    Returns
    -------
    Clean
    """
    record = task.prepare(inspected.trace, inspected.preflight.masked)
    none = np.zeros(len(record.valid), dtype=bool)
    clean = Clean(inspected, record, inspected.preflight, none, none)
    if unfit(record):
        return clean
    unresolved = unresolved_motion(record, task.profile.data)
    unresolved &= record.valid
    settings["unresolved_motion_samples"] = int(unresolved.sum())
    clean = replace(clean, record=mask_samples(record, unresolved), unresolved=unresolved)
    return clean.without(clean.above_steps(find_spikes(clean.record)))


def unfit(record: Record) -> str:
    """Return why no baseline can be fitted.

    Parameters
    ----------
    record : Record
        Record.

    Returns
    -------
    str
        A sentence; empty where one can be fitted.
    """
    usable, columns = int(record.valid.sum()), record.base.shape[1]
    needed = _SAMPLES_PER_COEFFICIENT * columns
    if usable < needed:
        return f"{usable} usable samples for {columns} baseline coefficients; needed: {needed}"
    torque = record.torque_nm[record.valid]
    if not float(np.ptp(torque)) > 0.0:
        return f"the torque is {float(torque[0]):.6g} N m throughout; needed: a live channel"
    return ""


def with_terms(
    model: BenchModel, held: tuple[CauseTerm, ...], acquired: list[Acquired]
) -> BenchModel:
    """Return the model with the faults that it held before and those that were named.

    Parameters
    ----------
    model : BenchModel
        Extended model without causes of the acquisition.
    held : tuple of CauseTerm
        Those of the model at hand.
    acquired : list of Acquired
        Named faults.

    Returns
    -------
    BenchModel
    """
    terms = [one.term for one in acquired if one.term is not None]
    return replace(model, causes=(*model.causes, *held, *terms))
