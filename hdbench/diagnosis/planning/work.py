"""From what a user asks for to a plan report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.diagnosis.planning.candidates import blocks, full_blocks, full_protocol, joined
from hdbench.diagnosis.planning.confusability import Confusability, compare
from hdbench.diagnosis.planning.motion import planned_motion
from hdbench.diagnosis.planning.propose import Pair, Proposal
from hdbench.diagnosis.planning.questions import effects_named, effects_of_result
from hdbench.diagnosis.planning.report import PlanReport
from hdbench.diagnosis.planning.segments import MotionPlan
from hdbench.diagnosis.planning.separate import DEFAULT_DURATION_S, propose
from hdbench.diagnosis.planning.signatures import Effect
from hdbench.diagnosis.planning.sketch import Noise
from hdbench.errors import DataError, UsageError
from hdbench.model import BenchModel, Motion, catalogue, motion_from_trace, simulate_run
from hdbench.profile import Profile
from hdbench.records import read_json, read_trace, resolve_input

__all__ = ["PlanRequest", "make_report"]

Told = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """What is asked for.

    Parameters
    ----------
    causes : tuple of str
        Names to be told apart; all of the catalogue where empty.
    of : Path or None
        Run or trace at hand; the profile's ripple run where None.
    result : Path or None
        Diagnosis (result file or run folder) whose open names are to be told apart.
    protocol : str or None
        Protocol to take instead of proposing one.
    duration_s : float or None
        Budget of sampled time, s; 180 where None.
    loads : bool
        Whether an operator can put loads on.
    """

    causes: tuple[str, ...] = ()
    of: Path | None = None
    result: Path | None = None
    protocol: str | None = None
    duration_s: float | None = None
    loads: bool = True


@dataclass(frozen=True, slots=True)
class _Question:
    """Names, pairs in question, and the run at hand."""

    profile: Profile
    effects: tuple[Effect, ...]
    pairs: tuple[tuple[str, str], ...]
    noise: Noise | None
    at_hand: Confusability


def make_report(request: PlanRequest, profile: Profile, progress: Told) -> PlanReport:
    """Say what the run at hand tells apart, and which run tells apart what is asked for.

    Parameters
    ----------
    request : PlanRequest
        What is asked for.
    profile : Profile
        Bench.
    progress : callable
        Told what is going on and the share done.

    Returns
    -------
    PlanReport

    Raises
    ------
    DataError
        If a name is unknown, or an input cannot be read.
    UsageError
        If there is no such protocol, or nothing is open in the diagnosis.
    """
    motion, source, noise = _at_hand(request, profile)
    effects, asked = _effects(request)
    at_hand = compare(motion, effects, profile.data, noise=noise, progress=progress)
    pairs = tuple((a, b) for a, b, _ in at_hand.confusable()) if asked is None else asked
    question = _Question(profile, effects, pairs, noise, at_hand)
    found: tuple[Proposal, Confusability | None]
    if request.protocol or not (request.causes or request.result):
        found = _fixed(question, request, progress)
    else:
        found = _proposed(question, request, progress)
    return PlanReport(source, at_hand, *found)


def _at_hand(request: PlanRequest, profile: Profile) -> tuple[Motion, str, Noise | None]:
    """Return motion, name and noise of the run at hand."""
    noise, source = None, request.of
    if request.result is not None:
        stored = _result(request.result)
        noise = _noise(stored, request.result)
        given = stored.get("input")
        if source is None and isinstance(given, str) and Path(given).exists():
            source = Path(given)
    if source is not None:
        trace = read_trace(resolve_input(source), require=("velocity",))
        return motion_from_trace(trace, profile.data), str(source), noise
    run = profile.data.ripple
    trace = simulate_run(
        profile.data,
        BenchModel.from_profile(profile.data),
        duration_s=run.duration_s,
        wave=run.reference,
        noise_nm=0.0,
        rng=np.random.default_rng(0),
    )
    name = f"the ripple run of {profile.name}, {run.duration_s:g} s"
    return motion_from_trace(trace, profile.data), name, noise


def _result(path: Path) -> dict[str, Any]:
    """Return a diagnosis result from its file or run folder."""
    return read_json(path / "result.json" if path.is_dir() else path, "hdbench/diagnosis/1")


def _noise(stored: Mapping[str, Any], path: Path) -> Noise | None:
    """Return the noise that a diagnosis found; None where it says nothing of it."""
    told = stored.get("settings", {}).get("noise")
    if told is None:
        return None
    try:
        noise = Noise(float(told["innovation_std"]), np.array(told["coefficients"], dtype=float))
    except (KeyError, TypeError, ValueError):
        noise = Noise(np.nan, np.zeros(0))
    if not (0.0 < noise.std_nm < np.inf and noise.coefficients.ndim == 1):
        raise DataError(
            "key settings.noise holds no autoregression; needed: innovation_std above 0 N m and "
            "a list of coefficients",
            where=str(path),
            fix="name a result that hdbench diagnose wrote",
        )
    return noise


def _effects(
    request: PlanRequest,
) -> tuple[tuple[Effect, ...], tuple[tuple[str, str], ...] | None]:
    """Return effects and the pairs in question; None for those that turn out to be confusable."""
    if request.result is not None:
        effects, pairs = effects_of_result(_result(request.result))
        if not pairs:
            raise UsageError(
                "every cause of this diagnosis has one name: nothing is open",
                where=str(request.result),
                fix="name causes with --cause to plan a run for them",
            )
        return effects, pairs
    if not request.causes:
        return effects_named(catalogue()), None
    named = effects_named(request.causes)
    if len(named) > 1:
        names = [effect.name for effect in named]
        return named, tuple((a, b) for a in names for b in names if a != b)
    (only,) = named
    others = [name for name in only.cause.look_alikes if name in catalogue()]
    pairs = tuple(pair for other in others for pair in ((only.name, other), (other, only.name)))
    return effects_named((only.name, *others)), pairs


def _fixed(
    question: _Question, request: PlanRequest, progress: Told
) -> tuple[Proposal, Confusability]:
    """Return a protocol that was asked for by name, and what it does."""
    profile = question.profile.data
    name = request.protocol or "full"
    known = {block.name: block for block in blocks(profile)}
    if name == "full":
        chosen = full_blocks(profile, loads=request.loads)
        plan = full_protocol(profile, loads=request.loads)
    elif name in known:
        chosen = (known[name],)
        plan = joined(name, chosen, known[name].shows)
    else:
        raise UsageError(
            f"no protocol {name!r}; needed: full, {', '.join(known)}",
            where="--protocol",
            fix="name one of them",
        )
    proposed = _on(plan, question, progress)
    words = tuple(f"{b.name} ({b.duration_s:.0f} s): {b.shows}" for b in dict.fromkeys(chosen))
    pairs = tuple(
        Pair(a, b, question.at_hand.share(a, b), proposed.share(a, b)) for a, b in question.pairs
    )
    return Proposal(plan, chosen, pairs, words), proposed


def _proposed(
    question: _Question, request: PlanRequest, progress: Told
) -> tuple[Proposal, Confusability | None]:
    """Return a run proposed for the pairs, and what it does."""
    found = propose(
        question.effects,
        question.pairs,
        question.profile.data,
        duration_s=request.duration_s or DEFAULT_DURATION_S,
        loads=request.loads,
        noise=question.noise,
        progress=progress,
    )
    pairs = tuple(replace(p, before=question.at_hand.share(p.first, p.second)) for p in found.pairs)
    if found.plan is None or not any(pair.separated for pair in pairs):
        return Proposal(None, (), pairs, ()), None
    return replace(found, pairs=pairs), _on(found.plan, question, progress)


def _on(plan: MotionPlan, question: _Question, progress: Told) -> Confusability:
    """Return how alike the names are on the motion of a plan."""
    profile = question.profile.data
    motion = planned_motion(plan, profile)
    return compare(motion, question.effects, profile, noise=question.noise, progress=progress)
