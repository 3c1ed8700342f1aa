"""One answer against one truth, which opens only with its seal."""

import hashlib
import json
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path


def open_truth(sealed, mark):
    """Return the truth if it is the one that `mark` was made of."""
    if hashlib.sha256((sealed["salt"] + sealed["text"]).encode()).hexdigest() != mark:
        raise ValueError(f"{sealed['key']}: the truth is not the one that was sealed")
    return json.loads(sealed["text"])


_NAMES = tomllib.loads(Path(__file__).with_name("names.toml").read_text())


def deviations(truth, matched, causes):
    """((family, parameter, deviation / bound, deviation / stated standard deviation), ...)."""
    out = []
    known = _NAMES["load_parameters" if truth["record"] == "loads" else "parameters"]
    for which, effect in enumerate(truth["hidden"]):
        if which not in matched or not effect["agrees"]:
            continue
        cause = causes[matched[which]]
        if cause["name"] != effect["name"]:
            continue
        for reported, (name, factor) in known.get(effect["name"], {}).items():
            entry = cause["parameters"].get(reported)
            if entry is None or name not in effect["bounds"]:
                continue
            factor = 1.0 / truth["seconds"] if factor == "per_s" else factor
            away = entry["value"] - factor * effect["values"][name]
            bound, std = factor * effect["bounds"][name], entry.get("std")
            if math.isfinite(away) and bound > 0.0:
                own = away / std if std else None
                out.append((effect["name"], reported, away / bound, own))
    return tuple(out)


_PLACES = {
    "order-3.37": ("motor-order", 3.37),
    "order-8": ("motor-order", 8.0),
    "subharmonic-0.5": ("motor-order", 0.5),
}
_KEYS = {"motor-order": "order", "frequency": "frequency_hz"}


def located(truth, answer):
    """(unexplained in the right domain, error of the place in bounds or None)."""
    if not truth["hidden"]:
        return False, None
    effect = truth["hidden"][0]
    allowed = _NAMES["near"].get(effect["domain"], [effect["domain"]])
    right = any(left["domain"] in allowed for left in answer["unexplained"])
    if effect["name"] not in _PLACES:
        return right, None
    domain, place = _PLACES[effect["name"]]
    found = [left["location"] for left in answer["unexplained"] if left["domain"] == domain]
    for cause in answer["causes"]:
        entry = cause.get("parameters", {}).get(_KEYS[domain])
        if entry is not None:
            found.append(entry["value"])
    if not found:
        return right, None
    # bound of an order whose amplitude is d sigmas, over R turns: sqrt(6) / (pi R d)
    bound = 6.0**0.5 / (3.14159265 * truth["turns"] * effect["d"])
    return right, min(abs(value - place) for value in found) / bound


# sine squared below which names span the same space (contract, section 5) ...
_GROUP = 0.01
# ... and below which a name that the answer puts into the group is not held against it: another
# form of the same effect turns a column by some degrees
_TOLERATED = 0.03
# faults whose flag is an answer too
_FLAGS = {
    "missed-samples", "spikes", "quantisation", "encoder-slip", "tacho-ripple",
    "speed-dependent-noise", "saturation",
}  # fmt: skip
# bad data: names, of causes or flags, that tell the fault
FAULT_NAMES = {fault: set(names) for fault, names in _NAMES["faults"].items()}


@dataclass(frozen=True)
class Verdict:
    """What one answer is worth; see the benchmark's page for the definitions."""

    hidden: int
    answered: bool = False
    alarm: bool = False
    exact: bool = False
    covered: bool = False
    set_size: float = 0.0
    wrong_certain: bool = False
    named: tuple = ()
    phantoms: int = 0
    unexplained: int = 0
    found: int = 0
    right_domain: bool = False
    place_error: float | None = None
    deviations: tuple = ()
    probability: float | None = None
    gain: tuple | None = None
    fault_told: bool = False


def names_of(cause):
    """All names that a cause may stand for."""
    return {cause["name"], *cause.get("group", ()), *cause.get("rivals", ())}


def same_names(effect, limit=_GROUP):
    """Names that mean the effect on its record."""
    return frozenset(name for name, value in effect["alike"].items() if value < limit)


def _fits(cause, entry):
    return not names_of(cause).isdisjoint({*same_names(entry), *entry.get("accept", ())})


def _is_exact(cause, entry):
    near = {*same_names(entry, _TOLERATED), *entry.get("accept", ())}
    return names_of(cause) <= near and _fits(cause, entry)


def _flagged(answer, entry):
    """Flags that name the fault: they are causes too."""
    name = entry["name"]
    return name in _FLAGS and any(flag["name"] == name for flag in answer.get("data_flags", ()))


def _tells_fault(told, answer):
    """Whether causes, minor ones or flags hold one of the names in `told`."""
    named = [*answer["causes"], *answer.get("minor", ())]
    flags = {flag["name"] for flag in answer.get("data_flags", ())}
    return bool(told & flags) or any(names_of(cause) & told for cause in named)


def match(causes, hidden, fits):
    """Give each effect one cause that fits, the fewest choices first; indices of causes."""
    out, taken = {}, set()
    options = [[k for k, cause in enumerate(causes) if fits(cause, entry)] for entry in hidden]
    for which in sorted(range(len(hidden)), key=lambda i: len(options[i])):
        free = [k for k in options[which] if k not in taken]
        if free:
            out[which] = free[0]
            taken.add(free[0])
    return out


def _set_size(cause):
    """Names in the set, those of one group counted once."""
    return 1.0 + len(set(cause.get("rivals", ())) - set(cause.get("group", ())))


def judge(truth, entry):
    """Judge one answer (an entry of the runner) by the truth."""
    hidden = truth["hidden"]
    answer = entry.get("answer")
    if answer is None:
        return Verdict(len(hidden))
    causes, left = answer["causes"], answer["unexplained"]
    flagged = [_flagged(answer, effect) for effect in hidden]
    matched = match(causes, hidden, _fits)
    exact = match(causes, hidden, _is_exact)
    found = {k for k in range(len(hidden)) if k in matched or flagged[k]}
    right = {k for k in range(len(hidden)) if k in exact or flagged[k]}
    told = FAULT_NAMES.get(truth["fault"], set())
    strays = [
        c for k, c in enumerate(causes) if k not in matched.values() and not names_of(c) & told
    ]
    alarm = bool(causes or left or any(flagged))
    sizes = [_set_size(causes[k]) for k in matched.values()]
    certain = any(not cause.get("rivals") for cause in strays)
    in_domain, error = located(truth, answer)
    first = causes[matched[0]] if 0 in matched else None
    return Verdict(
        len(hidden),
        answered=True,
        alarm=alarm,
        exact=bool(hidden) and len(right) == len(hidden) and not strays and not left,
        covered=bool(hidden) and len(found) == len(hidden),
        set_size=sum(sizes) / len(sizes) if sizes else 1.0,
        wrong_certain=certain and not found,
        named=tuple(cause["name"] for cause in causes),
        phantoms=len(strays),
        unexplained=len(left),
        found=len(found),
        right_domain=in_domain,
        place_error=error,
        deviations=deviations(truth, matched, causes),
        probability=_probability(first or (causes[0] if causes else None)),
        gain=_gain(truth, answer),
        fault_told=_tells_fault(told, answer),
    )


def _probability(cause):
    """Chance that the answer gives its first name: the one told, else its share among its rivals.

    A set of k names whose evidence differs by at most 3 nats; without the differences of the
    rivals the name itself has at least 1 / k, and with none it is certain.
    """
    if cause is None:
        return None
    if cause.get("probability") is not None:
        return cause["probability"]
    return 1.0 / _set_size(cause)


def _gain(truth, answer):
    """(explained by the answer, explained by the oracle), held out."""
    oracle = truth.get("oracle")
    try:
        before = answer["simulated"]["heldout_rms_nm"]
        after = answer["extended"]["heldout_rms_nm"]
    except (KeyError, TypeError):
        return None
    if not oracle or not before or not after:
        return None
    best = 1.0 - (oracle["after_nm"] / oracle["before_nm"]) ** 2
    return 1.0 - (after / before) ** 2, best
