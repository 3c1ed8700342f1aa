"""A mapping that names and units suggest; the name of the file says nothing."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from hdbench.importing.convert import TURN_RAD, TURNING, unlike_pace
from hdbench.importing.listing import ChannelFacts
from hdbench.importing.recipe import Recipe
from hdbench.importing.source import Channel
from hdbench.importing.units import bare_name, target_unit, unit_scale
from hdbench.system.files import packaged_toml

_TOLD = packaged_toml(__package__, "words.toml")
_WORDS = {target: words.split() for target, words in _TOLD["quantities"].items()}
_KINDS = {kind: words.split() for kind, words in _TOLD["kinds"].items()}
_COUNTED = ("torque_nm", "motor_angle_rad", "motor_velocity_rad_s", "motor_current_a")
# shorter words begin others by chance
_COMPOUND = 4
_SPLIT = re.compile(r"[\W\d_]+|(?<=[a-z])(?=[A-Z])")
_NUMBERED = re.compile(r".*?[^\W\d](?:_|\[|\.)?(?P<joint>\d{1,2})\]?")
_Best = tuple[ChannelFacts, str]
# seconds since 1970 of the years 1998 to 2103, and in what else they are counted
_FIRST_S, _LAST_S = 9e8, 4.2e9
_SINCE_1970 = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# a log of a drive is sampled faster than this; a slower one has a time in another unit
_SLOWEST_HZ = 5.0


@dataclass(frozen=True, slots=True)
class Proposal:
    """A mapping with its reasons."""

    recipe: Recipe  # what is proposed
    reasons: dict[str, str]  # why, by column or option
    # what the file does not say and a person has to; the command has words in capitals there
    needs: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()  # joints that there are, where the mapping takes one of several
    no_time: bool = False  # whether the file has no time, so that it cannot be taken without a rate
    extra: tuple[str, ...] = ()  # options that the command has beside those of the recipe
    # channel behind each column that is proposed
    channels: dict[str, str] = field(default_factory=dict)

    def command(self, file: Path, out: Path) -> str:
        """Return the command that takes this mapping."""
        words = ["hdbench", "import", str(file), *self.recipe.options(), *self.extra]
        return " ".join(shlex.quote(word) for word in [*words, "--out", str(out)])

    def taken(self) -> Recipe:
        """Return the recipe with the options that go with it."""
        if "--velocity-from-angle" in self.extra:
            cutoff = float(self.extra[self.extra.index("--velocity-from-angle") + 1])
            return replace(self.recipe, velocity_from_angle_hz=cutoff)
        return self.recipe

    def to_dict(self, file: Path, out: Path) -> dict[str, Any]:
        """Return the proposal as ``--json`` prints it."""
        return {
            "map": dict(self.recipe.map),
            "reasons": self.reasons,
            "needs": list(self.needs),
            "joints": list(self.joints),
            "command": self.command(file, out),
        }


def _tokens(name: str) -> list[str]:
    last = bare_name(name).rpartition("/")[2]
    return [word.lower() for word in _SPLIT.split(last) if word]


def _says(tokens: Iterable[str], words: Iterable[str]) -> bool:
    """Return whether a word is there, or one that begins with it: Abtriebsdrehzahl."""
    return any(
        token == word or (len(word) >= _COMPOUND and token.startswith(word))
        for word in words
        for token in tokens
    )


def _is_behind(channel: Channel) -> bool:
    """Return whether a channel is named as one of the side behind the gear."""
    tokens = [*_tokens(channel.clock), *_tokens(channel.name.replace("/", " "))]
    return _says(tokens, _KINDS["output"]) and not _says(tokens, _KINDS["motor"])


def _joint(channel: Channel) -> str:
    """Return the joint that a name tells: a part of its path, or a number at its end."""
    parts = channel.name.strip("/").split("/")
    topic = channel.clock.strip("/").split("/")
    if len(parts) > len(topic) + 1 and parts[: len(topic)] == topic and topic != [""]:
        return "/".join(parts[len(topic) : -1])
    match = _NUMBERED.fullmatch(bare_name(parts[-1]))
    return match["joint"] if match else ""


def _rank(facts: ChannelFacts, target: str) -> tuple[int, str]:
    """Return how well a channel suits a column, 0 for not at all, and why."""
    channel = facts.channel
    if facts.is_text or facts.least is None or channel.is_time:
        return 0, ""
    tokens = _tokens(channel.name)
    heads = [head for head in _KINDS["heads"] for token in tokens if token.endswith(head)]
    word = next((w for w in _WORDS[target] if w in tokens or w in heads), None)
    ours = target_unit(target)
    scale = unit_scale(channel.unit, ours)
    score = 2 * (word is not None) + (scale is not None)
    if (
        not score
        or (scale is not None and scale.is_nan())
        or _says(tokens, _KINDS["no_quantity"])
        # only a unit tells volts, and only a known one is asked for no factor
        or (target == "torque_v" and (scale is None or word is None))
        or (target == "temperature_c" and channel.unit and scale is None)
    ):
        return 0, ""
    why = f"unit {channel.unit}" if channel.unit else f"no unit stated: taken as {ours}"
    if scale is None and channel.unit:
        why += " is not known"
    if word:
        why = f"named {word!r}, {why}"
    return (2 + score if is_measured(channel.name) else 1), why


def time_candidate(channels: Sequence[Channel]) -> Channel | None:
    """Return the channel that is named as a time; one that the file gives as such comes first."""
    own = [c for c in channels if c.is_time]
    named = [c for c in channels if set(_KINDS["time"]).intersection(_tokens(c.name))]
    united = [c for c in channels if is_unit(c, "s")]
    return next(iter([*own, *named, *united]), None)


def is_measured(name: str) -> bool:
    """Return whether a channel's name does not say that it was asked for or estimated."""
    return not _says(_tokens(name), _KINDS["not_measured"])


def is_unit(channel: Channel, wanted: str) -> bool:
    """Return whether a channel states a unit of a quantity."""
    scale = unit_scale(channel.unit, wanted)
    return scale is not None and not scale.is_nan()


def _choose(facts: Sequence[ChannelFacts], joint: str | None) -> tuple[dict[str, _Best], list[str]]:
    """Return the best channel for each column, of one joint, and the joints that there are."""
    ranked: dict[str, list[tuple[int, str, ChannelFacts]]] = {}
    for target in _WORDS:
        found = [(*_rank(f, target), f) for f in facts]
        best = max((score for score, _, _ in found), default=0)
        if best:
            ranked[target] = [entry for entry in found if entry[0] == best]
    joints: list[str] = []
    for target in ("torque_nm", "motor_velocity_rad_s", *_WORDS):
        own = [_joint(f.channel) for _, _, f in ranked.get(target, [])]
        if len(set(own)) > 1:
            joints = list(dict.fromkeys(own))
            break
    chosen = joint if joint is not None else next(iter(joints), None)
    result: dict[str, _Best] = {}
    clock = None
    if "torque_nm" in ranked:
        ranked.pop("torque_v", None)
    for target in ("torque_nm", "torque_v", *ranked):
        entries = ranked.get(target, [])
        of_joint = [e for e in entries if chosen is None or _joint(e[2].channel) == chosen]
        same_clock = [e for e in of_joint if clock in (None, e[2].channel.clock)]
        for _, why, fact in (same_clock or of_joint or entries)[:1]:
            result[target] = (fact, why)
            clock = clock if clock is not None else fact.channel.clock
    return result, joints


def _shortest(name: str, channels: Sequence[Channel], joint: str | None) -> str:
    """Return the end of a name that is enough to find it."""
    # a unit behind the name may hold a stroke too
    bare = bare_name(name)
    parts = bare.split("/")
    for k in range(len(parts) - 1, -1, -1):
        short = "/".join(parts[k:]) + name[len(bare) :]
        alike = [c for c in channels if c.name == short or c.name.endswith(f"/{short}")]
        if joint is not None:
            alike = [c for c in alike if joint in c.name.split("/")] or alike
        if short and len(alike) == 1:
            return short
    return name


def _words_for(target: str, facts: ChannelFacts, joint_side: bool) -> tuple[str, list[str]]:
    """Return the declared conversions of a channel, and why."""
    words, why = "", []
    scale = unit_scale(facts.channel.unit, target_unit(target))
    if facts.bits:
        words += f"@int{facts.bits}"
        why.append(f"whole numbers at both ends of {facts.bits} bits: two's complement")
    if scale is not None and scale != 1:
        words += f"@{facts.channel.unit}"
    if target == "motor_angle_rad" and facts.least is not None and facts.most is not None:
        turn = TURN_RAD / float(scale or 1)
        if facts.jump > 0.5 * turn and facts.most - facts.least <= 1.01 * turn:
            words += "@wrapped"
            why.append("jumps within one turn")
        if not joint_side and abs(facts.first or 0.0) > turn:
            words += "@zero"
            why.append("begins many turns from 0")
    return words, why


def _time_unit(facts: ChannelFacts) -> tuple[str, str]:
    """Return the unit of a time and why; empty where nothing tells it."""
    channel = facts.channel
    if unit_scale(channel.unit, "s") is not None:
        return channel.unit, ""
    if facts.first is None or channel.name.endswith("_s"):
        return "s", ""
    for unit, scale in _SINCE_1970.items():
        if _FIRST_S <= facts.first * scale < _LAST_S:
            return unit, f", {unit} since 1970"
    if facts.rate_hz is None or facts.rate_hz >= _SLOWEST_HZ:
        return "s", ", no unit stated: taken as s"
    return "", ""


def _disagreement(best: Mapping[str, _Best], time: ChannelFacts, unit: str) -> str:
    """Return how velocity and rate of the angle differ; empty where they do not."""
    if not {*TURNING} <= best.keys():
        return ""
    angle, velocity = (best[target][0] for target in TURNING)
    if not len(angle.numbers) == len(velocity.numbers) == len(time.numbers):
        return ""
    scales = [float(unit_scale(unit, "s") or 1)] if unit else [*_SINCE_1970.values()]
    turned = [
        facts.numbers * float(unit_scale(facts.channel.unit, target_unit(target)) or 1)
        for facts, target in zip((angle, velocity), TURNING, strict=True)
    ]
    ratios = [unlike_pace(time.numbers * scale, *turned) for scale in scales]
    if None in ratios:
        return ""
    told = f"{ratios[0]:.4g} times" if unit else "in no unit of time"
    return f"the velocity is {told} the rate of the angle"


def proposed_mapping(
    facts: Sequence[ChannelFacts],
    given: Recipe,
    channels: Sequence[Channel],
    bench: str | None = None,
) -> Proposal:
    """Propose a mapping."""
    best, joints = _choose(facts, given.joint)
    joint = given.joint if given.joint is not None else next(iter(joints), None)
    reasons: dict[str, str] = {}
    needs: list[str] = []
    extra: list[str] = []
    torque = best.get("torque_nm") or best.get("torque_v")
    clock = next((f.channel.clock for f, _ in best.values()), "")
    # a current stands in where no torque is there
    if torque is None and "motor_current_a" in best:
        extra += ["--torque-constant", "N_M_PER_A"]
        needs.append("N_M_PER_A: the torque per current of this motor, N m/A")
    elif torque is None:
        needs.append("no channel is named as a torque or a current: --map torque_nm=COLUMN")
        extra += ["--map", "torque_nm=COLUMN"]
    turning = {t: f.channel for t, (f, _) in best.items() if t in TURNING}
    behind = {t: c.name for t, c in turning.items() if _is_behind(c)}
    joint_side = given.side == "output" or (bool(behind) and behind.keys() == turning.keys())
    mapping: dict[str, str] = {}
    empty = {f.channel.name for f in facts if f.least is None}
    of_clock = [c for c in channels if c.clock == clock and c.name not in empty]
    time = time_candidate(of_clock)
    unlike = ""
    for facts_of_time in (f for f in facts if f.channel == time and given.rate_hz is None):
        unit, why = _time_unit(facts_of_time)
        word = "" if unit == "s" else f"@{unit or 'TIME_UNIT'}"
        mapping["time_s"] = _shortest(facts_of_time.channel.name, channels, joint) + word
        named = "the time of its clock" if facts_of_time.channel.is_time else "named as a time"
        reasons["time_s"] = named + why
        if not unit:
            rate = f"{facts_of_time.rate_hz or 0.0:.3g} Hz"
            needs.append(f"TIME_UNIT: s, ms, us or ns; in s it would be sampled at {rate}")
        if len(behind) != 1:
            unlike = _disagreement(best, facts_of_time, unit)
    if unlike and all(best[target][0].channel.unit for target in TURNING):
        needs.append(f"{unlike}: put @output or another unit behind the one that has it")
    for target, (fact, why) in best.items():
        if target == "motor_current_a" and torque is not None and not why.startswith("named"):
            continue
        words, more = _words_for(target, fact, joint_side)
        name = _shortest(fact.channel.name, channels, joint)
        factor = ""
        counts = target in _COUNTED and (fact.whole or (unlike and target in TURNING))
        if counts and not fact.channel.unit:
            word = "N_M_PER_COUNT" if target == "torque_nm" else f"{target.upper()}_FACTOR"
            factor = f"*{word}"
            why = why.partition(": taken")[0]
            told = f", and {unlike}" if unlike and target in TURNING else ""
            what = "the torque" if target == "torque_nm" else target_unit(target)
            needs.append(f"{word}: {what} per count; it is not in the file{told}")
        elif fact.channel.unit and unit_scale(fact.channel.unit, target_unit(target)) is None:
            factor = f"*{target.upper()}_FACTOR"
            unit = f"{target_unit(target)} per {fact.channel.unit}"
            needs.append(f"{target.upper()}_FACTOR: {unit}; the unit is not known")
        if target in behind and not joint_side:
            words += "@output"
            more.append("behind the gear")
        mapping[target] = name + factor + words
        reasons[target] = ", ".join([why, *more])
    recipe = replace(given, map=mapping)
    if joint_side and given.side != "output":
        recipe = replace(recipe, side="output")
        reasons["--side output"] = "a joint is named: angles and velocities are behind the gear"
    if joint_side or behind:
        extra += ["--profile", bench or "PROFILE.toml"]
        if bench is None:
            needs.append("PROFILE.toml: the profile of this drive, for its gear ratio")
    if joints and given.joint is None:
        recipe = replace(recipe, joint=joints[0])
        reasons["--joint"] = f"one of {len(joints)} joints: {', '.join(joints)}"
    if "motor_velocity_rad_s" not in best and "motor_angle_rad" in best:
        rate_hz = given.rate_hz or best["motor_angle_rad"][0].rate_hz
        cutoff = f"{rate_hz / 10.0:.3g}" if rate_hz else "CUTOFF_HZ"
        extra += ["--velocity-from-angle", cutoff]
        reasons["--velocity-from-angle"] = "no velocity; low-pass at a tenth of the sample rate"
    no_time = given.rate_hz is None and "time_s" not in mapping
    if no_time:
        extra += ["--rate", "RATE_HZ"]
        needs.append("RATE_HZ: the rate at which it was sampled; it is not in the file")
    taken = {target: fact.channel.name for target, (fact, _) in best.items()}
    return Proposal(recipe, reasons, tuple(needs), tuple(joints), no_time, tuple(extra), taken)
