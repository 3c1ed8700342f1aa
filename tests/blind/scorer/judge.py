"""One answer against one truth."""

from dataclasses import dataclass, field

from .parameters import deviations
from .places import located

__all__ = ["FAULT_NAMES", "GROUP", "Verdict", "judge", "match", "names_of"]

# sine squared below which names span the same space (contract, section 5) ...
GROUP = 0.01
# ... and below which a name that the answer puts into the group is not held against it: another
# form of the same effect turns a column by some degrees
_TOLERATED = 0.03
_FLAGS = {
    "missed-samples": {"missed-samples"},
    "spikes": {"spikes"},
    "quantisation": {"quantisation"},
    "encoder-slip": {"encoder-slip"},
    "tacho-ripple": {"tacho-ripple"},
    "speed-dependent-noise": {"speed-dependent-noise"},
    "saturation": {"saturation"},
}
# bad data: names, of causes or flags, that tell the fault; none for what is no fault
FAULT_NAMES = {
    "gaps": {"missed-samples"},
    "clipping": {"saturation"},
    "slip": {"encoder-slip"},
    "wrong-units": {"wrong-channel", "torque-scale", "wrong-unit"},
    "swapped-channel": {"wrong-channel", "swapped-channel"},
    "stuck": {"stuck-value"},
    "noisy-load-cell": set(),
}


@dataclass(frozen=True)
class Verdict:
    """What one answer is worth; see the benchmark's page for the definitions."""

    answered: bool
    alarm: bool
    exact: bool
    covered: bool
    set_size: float
    wrong_certain: bool
    named: tuple
    phantoms: int
    unexplained: int
    found: int
    hidden: int
    right_domain: bool
    place_error: float | None
    rivals_told: bool
    deviations: tuple = field(default=())
    probability: float | None = None
    gain: tuple | None = None
    fault_told: bool = False


def names_of(cause):
    """All names that a cause may stand for."""
    return {cause["name"], *cause.get("group", ()), *cause.get("rivals", ())}


def _groups(entry):
    """Names that mean the same on this record, and names that nearly do."""
    alike = entry["alike"]
    same = {name for name, value in alike.items() if value < GROUP} | set(entry.get("accept", ()))
    return same, same | {name for name, value in alike.items() if value < _TOLERATED}


def _fits(cause, entry):
    same, _ = _groups(entry)
    return bool(names_of(cause) & same)


def _is_exact(cause, entry):
    same, near = _groups(entry)
    return cause["name"] in near and names_of(cause) <= near and bool(names_of(cause) & same)


def _flagged(answer, entry):
    """Flags that name the fault: they are causes too."""
    known = _FLAGS.get(entry["name"], set())
    return any(flag["name"] in known for flag in answer.get("data_flags", ()))


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


def _empty(hidden):
    return Verdict(False, False, False, False, 0.0, False, (), 0, 0, 0, len(hidden), False, None,
                   False)  # fmt: skip


def judge(truth, entry):
    """Judge one answer (an entry of the runner) by the truth."""
    hidden = truth["hidden"]
    answer = entry.get("answer")
    if answer is None:
        return _empty(hidden)
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
        hidden=len(hidden),
        right_domain=in_domain,
        place_error=error,
        rivals_told=any(cause.get("rivals") for cause in causes),
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
