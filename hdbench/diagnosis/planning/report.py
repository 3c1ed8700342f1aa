"""Plan report: from what a user asks for to plain data, schema ``hdbench/plan-report/1``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.diagnosis.planning.blocks import Block, blocks, full_blocks, full_protocol, joined
from hdbench.diagnosis.planning.confusability import CONFUSABLE, Confusability, compare
from hdbench.diagnosis.planning.frame import Noise
from hdbench.diagnosis.planning.motion import planned_motion
from hdbench.diagnosis.planning.planfile import plan_to_dict
from hdbench.diagnosis.planning.proposal import (
    DEFAULT_DURATION_S,
    Pair,
    Proposal,
    effects_named,
    effects_of_result,
    propose,
    settled_by,
)
from hdbench.diagnosis.planning.segments import MotionPlan
from hdbench.diagnosis.planning.signatures import Effect
from hdbench.errors import DataError, UsageError
from hdbench.model import BenchModel, Motion, catalogue, motion_from_trace, simulate_run
from hdbench.profile import Profile
from hdbench.profile.schema import ProfileData
from hdbench.records import read_json, read_trace, resolve_input

__all__ = ["PlanReport", "PlanRequest", "make_report", "report_dict"]

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
class PlanReport:
    """A run at hand, and a run proposed, with how alike the causes are on each.

    Parameters
    ----------
    source : str
        Name of the run at hand.
    at_hand : Confusability
        How alike the causes are on it.
    proposal : Proposal
        The proposed run.
    proposed : Confusability or None
        How alike they are on that one; None where no run is proposed.
    """

    source: str
    at_hand: Confusability
    proposal: Proposal
    proposed: Confusability | None


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
    bench = profile.data
    motion, source, noise = _at_hand(request, profile)
    effects, asked = _effects(request)
    at_hand = compare(motion, effects, bench, noise=noise, progress=progress)
    pairs = tuple((a, b) for a, b, _ in at_hand.confusable()) if asked is None else asked
    if request.protocol or not (request.causes or request.result):
        plan, chosen = _protocol(request, bench)
        planned = planned_motion(plan, bench)
        after = compare(planned, effects, bench, noise=noise, progress=progress)
        shares = tuple(Pair(a, b, at_hand.share(a, b), after.share(a, b)) for a, b in pairs)
        words = tuple(f"{b.name} ({b.duration_s:.0f} s): {b.shows}" for b in dict.fromkeys(chosen))
        return PlanReport(source, at_hand, Proposal(plan, chosen, shares, words, after), after)
    found = propose(
        effects, pairs, bench, at_hand=at_hand, loads=request.loads, noise=noise,
        progress=progress, duration_s=request.duration_s or DEFAULT_DURATION_S,
    )  # fmt: skip
    if not any(pair.separated for pair in found.pairs):
        found = Proposal(None, (), found.pairs, ())
    return PlanReport(source, at_hand, found, found.after)


def _at_hand(request: PlanRequest, profile: Profile) -> tuple[Motion, str, Noise | None]:
    """Return motion, name and noise of the run at hand."""
    bench, noise, source = profile.data, None, request.of
    if request.result is not None:
        stored = _result(request.result)
        noise = _noise(stored, request.result, bench)
        given = stored.get("input")
        if source is None and isinstance(given, str) and Path(given).exists():
            source = Path(given)
    if source is not None:
        trace = read_trace(resolve_input(source), require=("velocity",))
        return motion_from_trace(trace, bench), str(source), noise
    run = bench.ripple
    trace = simulate_run(
        bench, BenchModel.from_profile(bench), duration_s=run.duration_s, wave=run.reference,
        noise_nm=0.0, rng=np.random.default_rng(0),
    )  # fmt: skip
    name = f"the ripple run of {profile.name}, {run.duration_s:g} s"
    return motion_from_trace(trace, bench), name, noise


def _result(path: Path) -> dict[str, Any]:
    """Return a diagnosis result from its file or run folder."""
    return read_json(path / "result.json" if path.is_dir() else path, "hdbench/diagnosis/1")


def _noise(stored: Mapping[str, Any], path: Path, profile: ProfileData) -> Noise | None:
    """Return the noise that a diagnosis found; None where it says nothing of it."""
    told = stored.get("settings", {}).get("noise")
    if told is None:
        return None
    try:
        if "coefficients" in told:
            std, weights = float(told["innovation_std"]), np.array(told["coefficients"], float)
            noise = Noise.autoregression(std, weights, profile.daq.sample_period_s)
        elif "std_nm" in told:
            noise = Noise.white(float(told["std_nm"]))
        else:
            noise = Noise(np.array(told["frequency_hz"], float), np.array(told["power_nm2"], float))
        good = len(noise.frequency_hz) == len(noise.power_nm2) > 0
        good &= bool(np.all((noise.power_nm2 > 0.0) & (noise.power_nm2 < np.inf)))
        good &= bool(np.all(np.diff(noise.frequency_hz) > 0.0))
    except (KeyError, TypeError, ValueError):
        good = False
    if not good:
        raise DataError(
            "key settings.noise holds no spectrum; needed: frequency_hz, increasing, and "
            "power_nm2 above 0, or std_nm, or innovation_std above 0 N m and coefficients",
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


def _protocol(request: PlanRequest, profile: ProfileData) -> tuple[MotionPlan, tuple[Block, ...]]:
    """Return a protocol that was asked for by name, and its blocks."""
    name = request.protocol or "full"
    known = {block.name: block for block in blocks(profile)}
    if name == "full":
        plan = full_protocol(profile, loads=request.loads)
        return plan, full_blocks(profile, loads=request.loads)
    if name in known:
        return joined(name, (known[name],), known[name].shows), (known[name],)
    raise UsageError(
        f"no protocol {name!r}; needed: full, {', '.join(known)}",
        where="--protocol",
        fix="name one of them",
    )


def report_dict(report: PlanReport, header: Mapping[str, Any]) -> dict[str, Any]:
    """Return a report as ``--json`` prints it, beside the header's schema, version and profile.

    Parameters
    ----------
    report : PlanReport
        Report.
    header : mapping
        Schema, version and profile.

    Returns
    -------
    dict
    """
    proposal = report.proposal
    plan = proposal.plan
    return {
        **header,
        "source": report.source,
        "at_hand": _confusability(report.at_hand),
        "proposed": None if report.proposed is None else _confusability(report.proposed),
        "pairs": [_pair(pair) for pair in proposal.pairs],
        "words": list(proposal.words),
        "plan": None if plan is None else plan_to_dict(plan),
        "duration_s": None if plan is None else plan.duration_s,
        "needs_operator": plan is not None and plan.needs_operator,
    }


def _pair(pair: Pair) -> dict[str, Any]:
    known = catalogue()
    body: dict[str, Any] = {
        "first": pair.first,
        "second": pair.second,
        "sin2_at_hand": pair.before,
        "sin2_proposed": pair.after,
        "separated": pair.separated,
        "settled_by": None,
    }
    if not pair.separated and pair.first in known and pair.second in known:
        body["settled_by"] = settled_by(known[pair.first], known[pair.second])
    return body


def _confusability(found: Confusability) -> dict[str, Any]:
    return {
        "duration_s": found.duration_s,
        "visible": [
            {
                "name": entry.name,
                "std_nm": entry.std_nm,
                "detectable_nm": entry.detectable_nm,
                "baseline_share": entry.baseline_share,
            }
            for entry in found.visibility
            if entry.visible
        ],
        "invisible": [{"name": e.name, "reason": e.reason} for e in found.invisible()],
        "inseparable": [list(group) for group in found.inseparable()],
        "contained": [list(pair) for pair in found.contained()],
        "confusable_below": CONFUSABLE,
        "confusable": [{"first": a, "second": b, "sin2": s} for a, b, s in found.confusable()],
    }
