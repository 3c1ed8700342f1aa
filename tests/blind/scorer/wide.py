"""Parts T (several causes), W (nuisances of real logs) and U (unseen effects)."""

import statistics
from collections import defaultdict
from dataclasses import dataclass

from .judge import deviations, match, names_of, same_names
from .metrics import Row, coverage, mean, shares

# share of an effect that an axis or names have to span to be the right answer
SPANNED = 0.95
# held-out error above the noise that has to be told: a tenth of the noise, as RMS
_MARGIN = 1.1
# an entry of `unexplained` accounts for a rest that is up to twice its size
_TOLD = 0.5
# relative and absolute distance at which a line stands at its place
_ORDER, _HERTZ = 0.05, 0.2
# domains in which starts and stops of the shaft may be told
_TRANSIENT = {"time", "outliers", "variance", "acceleration", "frequency"}


@dataclass(frozen=True)
class Wide:
    """What one answer is worth."""

    answered: bool
    alarm: bool = False
    found: tuple = ()
    exact: bool = False
    false_causes: tuple = ()
    false_unexplained: int = 0
    rest_told: bool = True
    right: bool = False
    wrong_certain: bool = False
    by: str = ""
    deviations: tuple = ()


def _near_order(told, true):
    return any(abs(told - ratio * true) <= _ORDER for ratio in (1.0, 2.0, 3.0, 0.5, 1.0 / 3.0))


def _in_place(cause, effect):
    """Whether a line that gives its place gives the right one."""
    known, told = effect["shape"], cause.get("parameters") or {}
    if "order" in told and "order" in known:
        return _near_order(told["order"]["value"], known["order"])
    if "frequency_hz" in told and "frequency_hz" in known:
        return abs(told["frequency_hz"]["value"] - known["frequency_hz"]) <= _HERTZ
    return True


def _is_harmonic(cause, effect):
    """Whether the line is told by a multiple of its order: its order is then another number."""
    told = (cause.get("parameters") or {}).get("order")
    return told is not None and abs(told["value"] - effect["shape"].get("order", 1e9)) > _ORDER


def _fits(cause, effect):
    return bool(names_of(cause) & same_names(effect)) and _in_place(cause, effect)


def _is_exact(cause, effect):
    return _fits(cause, effect) and names_of(cause) <= same_names(effect)


def _refused(entry):
    answer = entry.get("answer")
    return answer is None or answer.get("verdict") == "data-bad"


def unreported_rest(truth, answer):
    """Whether the held-out error is above the noise and nothing accounts for it.

    The answer's own `rest` where it has one, else the noise that was injected.
    """
    rest = answer.get("rest") or {}
    noise, left = rest.get("noise_rms_nm"), rest.get("heldout_rms_nm")
    if noise is None or left is None:
        noise, left = truth["sigma_nm"], (answer.get("extended") or {}).get("heldout_rms_nm")
    if left is None or left <= _MARGIN * noise:
        return False
    # what walks cannot be foretold, held out or not: its name accounts for it
    if rest.get("told") or any("zero-random-walk" in names_of(c) for c in answer["causes"]):
        return False
    excess = (left**2 - noise**2) ** 0.5
    sizes = [entry.get("size_nm") or 0.0 for entry in answer["unexplained"]]
    return not any(size >= _TOLD * excess for size in sizes)


def _without_neutral(truth, answer):
    """Causes and unexplained places but for those that tell a nuisance by its own name."""
    neutral = set(truth.get("neutral", ()))
    # a hidden effect of that very name is no nuisance
    neutral -= {effect["name"] for effect in truth["hidden"]}
    causes = [cause for cause in answer["causes"] if not names_of(cause) & neutral]
    left = answer["unexplained"]
    if "transients" in truth.get("nuisances", {}) and truth["note"] == "rough":
        left = [entry for entry in left if entry["domain"] not in _TRANSIENT]
    return causes, left


def _several(truth, entry):
    answer, hidden = entry["answer"], truth["hidden"]
    causes, left = _without_neutral(truth, answer)
    every = [*causes, *answer.get("minor", ())]
    matched, exact = match(every, hidden, _fits), match(every, hidden, _is_exact)
    strays = [c for k, c in enumerate(causes) if k not in matched.values()]
    # all named, or a stray: what is told as unexplained beside all names is false
    complete = len(matched) == len(hidden)
    return Wide(
        answered=not _refused(entry),
        alarm=bool(causes or left),
        found=tuple(k in matched for k in range(len(hidden))),
        exact=complete and len(exact) == len(hidden) and not strays and not left,
        false_causes=tuple(cause["name"] for cause in strays),
        false_unexplained=len(left) if complete else 0,
        rest_told=truth["part"] != "T" or not unreported_rest(truth, answer),
        right=complete and not strays and not left,
        wrong_certain=any(not cause.get("rivals") for cause in strays) and not matched,
        deviations=_stated(truth, matched, every),
    )


def _scaled(truth):
    """(all sizes, sizes of lines) that a nuisance changes in the torque or in the log's angle."""
    nuisances = truth.get("nuisances", {}) if truth["note"] == "rough" else {}
    filtered = nuisances.get("rate", {}).get("anti_alias", False)
    return bool({"gain", "low-pass"} & set(nuisances)) or filtered, "output-encoder" in nuisances


def _stated(truth, matched, causes):
    """Deviations over stated standard deviations, of parameters that a nuisance leaves alone."""
    every, lines = _scaled(truth)
    plain = {
        which: k for which, k in matched.items()
        if not _is_harmonic(causes[k], truth["hidden"][which])
    }  # fmt: skip
    out = []
    for family, name, bound, own in deviations(truth, plain, causes):
        place = name in ("order", "frequency_hz", "resonance_hz", "time_constant_s")
        line = name == "amplitude_nm"
        if own is not None and (place or not (every or (lines and line))):
            out.append((family, name, bound, own))
    return tuple(out)


def _unseen(truth, entry):
    answer, spans = entry["answer"], entry.get("spans") or {}
    by_axis = any(value >= SPANNED for value in spans.get("unexplained", {}).values())
    by_name = spans.get("names", 0.0) >= SPANNED
    certain = [cause["name"] for cause in answer["causes"] if not cause.get("rivals")]
    return Wide(
        answered=not _refused(entry),
        alarm=bool(answer["causes"] or answer["unexplained"]),
        right=by_axis or by_name,
        wrong_certain=bool(certain) and not (by_axis or by_name),
        false_causes=tuple(certain) if not by_name else (),
        by="axis" if by_axis else "name" if by_name else "",
    )


def judge_wide(truth, entry):
    """Judge one answer of part T, W or U by the truth."""
    if entry.get("answer") is None:
        return Wide(answered=False, found=(False,) * len(truth["hidden"]))
    return _unseen(truth, entry) if truth["part"] == "U" else _several(truth, entry)


def _coverage(rows):
    return coverage([away for row in rows for away in row.verdict.deviations])


def _cpu(rows):
    spent = [row.entry.get("cpu_s", row.entry["seconds"]) for row in rows]
    return (statistics.median(spent) if spent else None, len(spent))


def _named(rows):
    return mean(found for row in rows for found in row.verdict.found)


def _false_causes(rows):
    return mean(len(row.verdict.false_causes) for row in rows)


def _figures_t(rows):
    return {
        "T_named": _named(rows),
        **shares(rows, {"T_right": "right", "T_exact": "exact"}),
        "T_false_causes": _false_causes(rows),
        "T_false_unexplained": mean(row.verdict.false_unexplained for row in rows),
        "T_unreported_rest": mean(not row.verdict.rest_told for row in rows),
        "T_coverage": _coverage(rows),
        "T_cpu_s": _cpu(rows),
    }


def _pairs(rows):
    """(plain, rough) rows of each pair of which both records were answered for."""
    by = defaultdict(dict)
    for row in rows:
        by[row.truth["pair"]][row.truth["note"]] = row
    return [(some["plain"], some["rough"]) for some in by.values() if len(some) == 2]


def _figures_w(rows):
    pairs = _pairs(rows)
    compared = [
        pair for pair in pairs if pair[0].truth["hidden"] and all(r.truth["compared"] for r in pair)
    ]
    clean = [pair for pair in pairs if not pair[0].truth["hidden"]]
    out = {"W_pairs": (float(len(pairs)), len(pairs))}
    for k, name in enumerate(("plain", "rough")):
        some = [pair[k] for pair in compared]
        out |= shares(some, {"W_detected": "alarm", "W_exact": "exact"}, f"_{name}")
        out |= shares([pair[k] for pair in clean], {"W_false_alarms": "alarm"}, f"_{name}")
        out |= {f"W_named_{name}": _named(some), f"W_false_causes_{name}": _false_causes(some)}
    rough = [pair[1] for pair in pairs]
    out["W_refused"] = mean(not row.verdict.answered for row in rough)
    out["W_coverage"] = _coverage([row for pair in compared for row in pair])
    return {**out, "W_cpu_s": _cpu(rough)}


def _figures_u(rows):
    return {
        "U_by_axis": mean(row.verdict.by == "axis" for row in rows),
        "U_by_name": mean(row.verdict.by == "name" for row in rows),
        **shares(
            rows, {"U_right": "right", "U_detected": "alarm", "U_wrong_certain": "wrong_certain"}
        ),
        "U_names_beside": _false_causes(rows),
        "U_cpu_s": _cpu(rows),
    }


def wide_figures(rows):
    """Figures of T, W and U from (truth, entry, Wide) rows: name to (value, count)."""
    out = {}
    for part, figures in (("T", _figures_t), ("W", _figures_w), ("U", _figures_u)):
        some = [Row(row) for row in rows if row[0]["part"] == part]
        out |= figures(some) if some else {}
    return out


def wide_line(truth, entry, verdict):
    """Marks of the record for one line of text."""
    words = []
    if truth["part"] == "U":
        spans = entry.get("spans") or {}
        best = max(spans.get("unexplained", {}).values(), default=0.0)
        shape = truth["hidden"][0]["shape"]
        order = f" x order {shape['order']:.3g}" if "order" in shape else ""
        words.append(f"{shape['recipe']}({', '.join(shape['axes'])}){order}")
        words.append(f"axis {best:.2f} names {spans.get('names', 0.0):.2f}")
        words.append(f"RIGHT by {verdict.by}" if verdict.right else "not right")
    else:
        words.append(f"named {sum(verdict.found)}/{len(verdict.found)}")
        words.append("RIGHT" if verdict.right else "not right")
    if truth["part"] == "W":
        sizes = ", ".join(truth["nuisances"]) if truth["note"] == "rough" else "none"
        words.append(f"nuisances: {sizes}" + ("" if truth["compared"] else " (not compared)"))
    if verdict.false_causes:
        words.append("false: " + ", ".join(verdict.false_causes))
    if verdict.false_unexplained:
        words.append(f"false unexplained: {verdict.false_unexplained}")
    if not verdict.rest_told:
        words.append("REST NOT TOLD")
    if verdict.wrong_certain:
        words.append("WRONG-CERTAIN")
    if not verdict.answered:
        words.append("REFUSED")
    return "; ".join(words)
