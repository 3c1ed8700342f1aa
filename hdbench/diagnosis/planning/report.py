"""Plan report: from what a user asks for to plain data, schema ``hdbench/plan-report/1``."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.diagnosis.evidence import Told
from hdbench.diagnosis.planning.blocks import blocks, full_blocks, full_protocol
from hdbench.diagnosis.planning.confusability import CONFUSABLE, Confusability, compare
from hdbench.diagnosis.planning.frame import Noise
from hdbench.diagnosis.planning.planfile import plan_to_dict
from hdbench.diagnosis.planning.proposal import (
    DEFAULT_DURATION_S,
    Names,
    Pair,
    Proposal,
    effects_named,
    effects_of_causes,
    propose,
    settled_by,
)
from hdbench.diagnosis.planning.segments import MotionPlan, planned_motion
from hdbench.diagnosis.planning.signatures import Effect
from hdbench.errors import DataError, UsageError
from hdbench.model import BenchModel, Motion, catalogue, motion_from_trace, simulate_run
from hdbench.profile import Profile
from hdbench.profile.schema import ProfileData
from hdbench.records import read_json, read_trace, resolve_input
from hdbench.results.diagnosis import DiagnosisResult

# what is told of an effect that a motion shows
_SHOWN = ("name", "std_nm", "detectable_nm", "baseline_share")


def plan_report(
    profile: Profile,
    progress: Told,
    *,
    causes: tuple[str, ...] = (),
    of: Path | None = None,
    result: Path | None = None,
    protocol: str | None = None,
    duration_s: float | None = None,
    loads: bool = True,
) -> tuple[dict[str, Any], MotionPlan | None]:
    """Say what the run at hand tells apart, and which run tells apart what is asked for.

    `causes` are names to be told apart, all of the catalogue where empty; `of` is a run or trace at
    hand, the profile's ripple run where None; `result` a diagnosis (file or folder) whose open
    names are to be told apart; `protocol` one to take, not to propose; `loads` says whether
    an operator can put loads on. Returned are what ``--json`` prints, without schema, version and
    profile, and the run, None where none of this bench tells anything apart. `DataError` for an
    unknown name or input, `UsageError` where there is no such protocol or nothing is open.
    """
    bench = profile.data
    stored = None
    if result is not None:
        file = result / "result.json" if result.is_dir() else result
        fix = "name a result that hdbench diagnose wrote"
        stored = DiagnosisResult.from_json(read_json(file, "hdbench/diagnosis/1"), str(file), fix)
        if of is None and stored.input and Path(stored.input).exists():
            of = Path(stored.input)
    noise = _noise(stored, result)
    motion, source = _at_hand(of, profile)
    effects, asked = _effects(causes, stored, result)
    at_hand = compare(motion, effects, bench, noise=noise, progress=progress)
    pairs = tuple((a, b) for a, b, _ in at_hand.confusable()) if asked is None else asked
    if protocol or asked is None:
        whole, words = _protocol(protocol or "full", bench, loads=loads)
        planned = planned_motion(whole, bench)
        after = compare(planned, effects, bench, noise=noise, progress=progress)
        shares = tuple(Pair(*pair, at_hand.share(*pair), after.share(*pair)) for pair in pairs)
        proposal = Proposal(whole, shares, words, after)
    else:
        proposal = propose(
            effects, pairs, bench, at_hand=at_hand, loads=loads, noise=noise,
            progress=progress, duration_s=duration_s or DEFAULT_DURATION_S,
        )  # fmt: skip
        if not any(pair.separated for pair in proposal.pairs):
            proposal = Proposal(None, proposal.pairs)
    plan = proposal.plan
    report = {
        "source": source,
        "at_hand": _confusability(at_hand),
        "proposed": None if proposal.after is None else _confusability(proposal.after),
        "pairs": [_pair(pair) for pair in proposal.pairs],
        "words": list(proposal.words),
        "plan": None if plan is None else plan_to_dict(plan),
        "duration_s": None if plan is None else plan.duration_s,
        "needs_operator": plan is not None and plan.needs_operator,
    }
    return report, plan


def _at_hand(source: Path | None, profile: Profile) -> tuple[Motion, str]:
    """Return motion and name of the run at hand: the profile's ripple run where none is given."""
    bench = profile.data
    if source is not None:
        trace = read_trace(resolve_input(source), require=("velocity",))
        return motion_from_trace(trace, bench), str(source)
    run = bench.ripple
    trace = simulate_run(
        bench, BenchModel.from_profile(bench), duration_s=run.duration_s, wave=run.reference,
        noise_nm=0.0, rng=np.random.default_rng(0),
    )  # fmt: skip
    name = f"the ripple run of {profile.name}, {run.duration_s:g} s"
    return motion_from_trace(trace, bench), name


def _noise(stored: DiagnosisResult | None, file: Path | None) -> Noise | None:
    """Return the noise that a diagnosis found; None where it says nothing of it."""
    told = None if stored is None else stored.settings.get("noise")
    if told is None:
        return None
    try:
        if "std_nm" in told:
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
            "power_nm2 above 0, or std_nm",
            where=str(file),
            fix="name a result that hdbench diagnose wrote",
        )
    return noise


def _effects(
    causes: tuple[str, ...], stored: DiagnosisResult | None, result: Path | None
) -> tuple[tuple[Effect, ...], tuple[Names, ...] | None]:
    """Return effects and the pairs in question; None for those that turn out to be confusable."""
    if stored is not None:
        effects, pairs = effects_of_causes(stored.causes)
        if not pairs:
            raise UsageError(
                "every cause of this diagnosis has one name: nothing is open",
                where=str(result),
                fix="name causes with --cause to plan a run for them",
            )
        return effects, pairs
    if not causes:
        return effects_named(catalogue()), None
    named = effects_named(causes)
    names = [effect.name for effect in named]
    if len(names) > 1:
        return named, tuple(permutations(names, 2))
    others = [name for name in named[0].cause.look_alikes if name in catalogue()]
    pairs = tuple(pair for b in others for pair in ((names[0], b), (b, names[0])))
    return effects_named((*names, *others)), pairs


def _protocol(
    name: str, profile: ProfileData, *, loads: bool
) -> tuple[MotionPlan, tuple[str, ...]]:
    """Return a protocol that was asked for by name, and what its blocks are for."""
    known = {block.name: block for block in blocks(profile)}
    if name == "full":
        plan, parts = full_protocol(profile, loads=loads), full_blocks(profile, loads=loads)
    elif name in known:
        plan, parts = known[name], (known[name],)
    else:
        raise UsageError(
            f"no protocol {name!r}; needed: full, {', '.join(known)}",
            where="--protocol",
            fix="name one of them",
        )
    words = (f"{b.name} ({b.duration_s:.0f} s): {b.purpose}" for b in dict.fromkeys(parts))
    return plan, tuple(words)


def _pair(pair: Pair) -> dict[str, Any]:
    known = catalogue()
    settled = None
    if not pair.separated and pair.first in known and pair.second in known:
        settled = settled_by(known[pair.first], known[pair.second])
    return {
        "first": pair.first,
        "second": pair.second,
        "sin2_at_hand": pair.before,
        "sin2_proposed": pair.after,
        "separated": pair.separated,
        "settled_by": settled,
    }


def _confusability(alike: Confusability) -> dict[str, Any]:
    return {
        "duration_s": alike.duration_s,
        "visible": [
            {key: getattr(entry, key) for key in _SHOWN}
            for entry in alike.visibility
            if not entry.reason
        ],
        "invisible": [
            {"name": entry.name, "reason": entry.reason}
            for entry in alike.visibility
            if entry.reason
        ],
        "inseparable": [list(group) for group in alike.inseparable()],
        "contained": [list(pair) for pair in alike.contained()],
        "confusable_below": CONFUSABLE,
        "confusable": [{"first": a, "second": b, "sin2": s} for a, b, s in alike.confusable()],
    }
