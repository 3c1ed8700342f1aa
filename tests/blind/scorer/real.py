"""Records that others measured, against what is known of them."""

from dataclasses import dataclass, field

from .judge import names_of
from .metrics import share

# names that are the same finding at one whole order
_AT_ORDER = {"ripple-harmonic", "tooth-mesh", "cogging"}
# names under which a difference between the directions is told
_DIRECTIONS = {"asymmetric-friction", "direction-asymmetry"}
_STDS = 3.0
_ORDER = 0.1
# a fitted amplitude may be off by this beside the published uncertainties: other models
_AMPLITUDE = 0.1


@dataclass(frozen=True)
class Real:
    """What one answer is worth."""

    answered: bool
    named: dict = field(default_factory=dict)
    orders: dict = field(default_factory=dict)
    forbidden: tuple = ()
    false_causes: tuple = ()
    parameters: dict = field(default_factory=dict)
    unexplained: int = 0
    cpu_s: float = 0.0
    heldout: tuple = ()


def _wanted(name, causes):
    """Index of the cause that tells `name`, or None."""
    wanted = _DIRECTIONS if name == "asymmetric-friction" else {name}
    return next((k for k, cause in enumerate(causes) if names_of(cause) & wanted), None)


def _value(parameters, name):
    entry = parameters.get(name)
    return None if entry is None else (float(entry["value"]), entry.get("std"))


def _lines(answer):
    """(order, amplitude, index of the cause or None) of every line the answer holds."""
    out = []
    for k, cause in enumerate([*answer["causes"], *answer.get("minor", ())]):
        parameters = cause.get("parameters") or {}
        order, amplitude = _value(parameters, "order"), _value(parameters, "amplitude_nm")
        if order is None or not names_of(cause) & _AT_ORDER:
            continue
        out.append((order[0], None if amplitude is None else amplitude[0], k))
        for name, entry in parameters.items():
            # harmonics of poles or slots: amplitude_1_nm is that of the order itself
            words = name.split("_")
            if len(words) == 3 and words[0] == "amplitude" and words[1].isdigit():
                out.append((order[0] * int(words[1]), float(entry["value"]), k))
    settings = answer.get("settings") or {}
    for entry in settings.get("baseline_ripple") or ():
        out.append((float(entry["order"]), float(entry["amplitude_nm"]), None))
    return out


def _orders(truth, answer):
    """order: (found, amplitude told), and the causes that tell one of them."""
    told, used = {}, set()
    lines = _lines(answer)
    for key in ("orders", "orders_in_baseline"):
        for text, (amplitude, std) in truth.get(key, {}).items():
            near = [line for line in lines if abs(line[0] - float(text)) <= _ORDER]
            used |= {line[2] for line in near if line[2] is not None}
            allowed = _STDS * std + _AMPLITUDE * amplitude
            sizes = [line[1] for line in near if line[1] is not None]
            close = [size for size in sizes if abs(size - amplitude) <= allowed]
            value = close[0] if close else next((line[1] for line in near), None)
            told[text] = (bool(close), value)
    return told, used


def _parameters(truth, causes):
    """name: (value, std, within 3 combined standard deviations, std at most 3 times known)."""
    out = {}
    for name, (known, spread) in truth.get("parameters", {}).items():
        found = None
        for cause in causes:
            found = found or _value(cause.get("parameters") or {}, name)
        if found is None:
            out[name] = (None, None, False, False)
            continue
        value, std = found[0], float(found[1] or 0.0)
        close = abs(value - known) <= _STDS * (std**2 + spread**2) ** 0.5
        out[name] = (value, std, close, 0.0 < std <= 3.0 * spread)
    return out


def _heldout(answer):
    """Held-out RMS without and with the cause that tells the directions apart, N m."""
    k = _wanted("asymmetric-friction", answer["causes"])
    gain = {} if k is None else answer["causes"][k].get("gain") or {}
    before, after = gain.get("heldout_rms_before_nm"), gain.get("heldout_rms_after_nm")
    return () if before is None or after is None else (before, after)


def judge_real(truth, entry):
    """Judge one answer by what is known of the record."""
    answer = entry.get("answer")
    if answer is None or answer.get("verdict") == "data-bad":
        return Real(False, dict.fromkeys(truth.get("named", ()), False), cpu_s=entry["cpu_s"])
    causes = answer["causes"]
    every = [*causes, *answer.get("minor", ())]
    hits = {name: _wanted(name, every) for name in truth.get("named", ())}
    orders, used = _orders(truth, answer)
    used |= {k for k in hits.values() if k is not None}
    forbidden = set(truth.get("must_not", ()))
    return Real(
        answered=True,
        named={name: k is not None for name, k in hits.items()},
        orders=orders,
        forbidden=tuple(c["name"] for c in every if c["name"] in forbidden),
        false_causes=tuple(c["name"] for k, c in enumerate(causes) if k not in used),
        parameters=_parameters(truth, every),
        unexplained=len(answer["unexplained"]),
        cpu_s=entry["cpu_s"],
        heldout=tuple(100.0 * v / entry["torque_rms_nm"] for v in _heldout(answer)),
    )


def real_figures(rows):
    """Sums over (truth, entry, Real) rows: name to (value, count)."""
    verdicts = [row[2] for row in rows]
    named = [hit for v in verdicts for hit in v.named.values()]
    orders = [hit for v in verdicts for hit, _ in v.orders.values()]
    close = [ok for v in verdicts for _, _, ok, _ in v.parameters.values()]
    tight = [ok for v in verdicts for _, _, _, ok in v.parameters.values()]
    sums = {
        "R_forbidden": [len(v.forbidden) for v in verdicts],
        "R_false": [len(v.false_causes) for v in verdicts],
        "R_refused": [not v.answered for v in verdicts],
        "R_cpu_s": [v.cpu_s for v in verdicts],
    }
    hits = {"R_named": named, "R_orders": orders, "R_parameters": close, "R_stds": tight}
    return {
        **{name: share(some) for name, some in hits.items()},
        **{name: (float(sum(some)), len(some)) for name, some in sums.items()},
    }
