"""Results of the experiments as text, and what speaks against them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hdbench_cli.text import Lines, probability, remark_lines, table, with_uncertainty

_ACCEPTED = {True: "yes", False: "no", None: "not decided"}
_OF = (
    ("mean_of_positions", "mean of positions"),
    ("any_one_position", "any one position"),
    ("naive", "were all experiments independent"),
)


def calibration_lines(result: Mapping[str, Any]) -> Lines:
    """Yield a calibration result: a row for each experiment, then what they give together."""
    heads = ("experiment", "gain N m/V", "zero N m", "residual N m", "n")
    rows = (
        (
            str(line["id"]),
            f"{line['gain_nm_per_v']:.4f}",
            f"{line['intercept_nm']:+.4f}",
            f"{line['residual_rms_nm']:.4f}",
            str(line["n"]),
        )
        for line in result["experiments"]
    )
    yield table(heads, rows, right=heads[1:], title="Gain per loading experiment")
    yield ""
    yield from calibration_summary(result)
    yield from remark_lines(result)


def calibration_summary(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield gain, consistency and acceptance."""
    yield f"gain         {with_uncertainty(result['gain_nm_per_v'], 'N m/V')}"
    if result["consistency"] is not None:
        between = _between(result["consistency_interval"])
        yield f"consistency  {result['consistency']:.2%}{between}"
    yield from _uncertainty(result)
    broken = [test["name"] for test in _tests(result) if test["passed"] is False]
    why = f": {', '.join(broken)} not held" if broken else ""
    yield f"accepted     {_ACCEPTED[result['accepted']]}{why}"


def _between(interval: Sequence[float | None] | None) -> str:
    """Return the interval; its upper end is open where few gains spread widely."""
    low, high = interval or (None, None)
    if low is None:
        return ""
    ends = f"above {low:.2%}" if high is None else f"{low:.2%} to {high:.2%}"
    return f"  (95 %: {ends})"


def _uncertainty(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield the expanded uncertainties and the class, where the result has them."""
    one = result.get("gain_basis") in ("residual", "repetitions")
    for key, words in _OF:
        body = result.get("uncertainty", {}).get(key)
        if body is None:
            continue
        where = "this position alone" if one and key == "mean_of_positions" else words
        dof = "" if body["dof"] is None else f", {body['dof']:.3g} dof"
        factor = f"k = {body['coverage_factor']:.2f}{dof}"
        expanded = f"{float(body['expanded']):#.2g}".rstrip(".")
        yield f"U (95 %)     {expanded} N m/V ({body['expanded_relative']:.2%}, {factor})  {where}"
    if result.get("class") is not None:
        yield f"class        {result['class']:g}, indicative, in the manner of EURAMET cg-14"


def _tests(result: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return list(result.get("acceptance", {}).get("tests", ()))


def calibration_failed(result: Mapping[str, Any]) -> str | None:
    """Return why the calibration is not accepted, or None."""
    if result["accepted"]:
        return None
    tests = _tests(result)
    broken = [test for test in tests if test["passed"] is False]
    if broken:
        told = [f"{t['name']} {t['value']:.4g}; needed: at most {t['limit']:.4g}" for t in broken]
        return f"calibration not accepted: {', '.join(told)}"
    if result["consistency"] is None:
        return "calibration not accepted: one loading experiment has no consistency; needed: two"
    untested = ", ".join(test["name"] for test in tests if test["passed"] is None)
    return f"calibration not accepted: no data to test {untested or 'the consistency'}"


def misalignment_lines(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield a misalignment result."""
    yield "Misalignment torque, once per output turn"
    yield f"amplitude     {with_uncertainty(result['amplitude_nm'], 'N m')}"
    yield f"peak to peak  {with_uncertainty(result['peak_to_peak_nm'], 'N m')}"
    yield f"phase         {with_uncertainty(result['phase_rad'], 'rad')}"
    for when in ("before", "after"):
        peak = with_uncertainty(result[when]["peak_to_peak_nm"], "N m")
        yield f"{when + ' filter':13s} {peak} peak to peak"
    yield f"output turns  {result['output_turns']:.2f}"
    yield from remark_lines(result)


def ripple_lines(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield a ripple result."""
    yield "Torque ripple"
    taken = {entry["order"]: entry["suppression_db"] for entry in result["suppression_db"]}
    for line in result["ripple"]:
        order = line["order"]
        yield f"order {order:<7g} {with_uncertainty(line['amplitude_nm'], 'N m')}"
        yield f"  phase       {with_uncertainty(line['phase_rad'], 'rad')}"
        if taken.get(order) is not None:
            yield f"  filter      takes {taken[order]:.1f} dB"
    others = [(f"also {line['order']:<8.4g}", line) for line in result.get("lines", ())]
    others += [(f"tone {t['frequency_hz']:<5.4g} Hz", t) for t in result.get("tones", ())]
    for head, line in others:
        yield (
            f"{head} {with_uncertainty(line['amplitude_nm'], 'N m')}"
            f"  false alarm {probability(line['false_alarm_probability'])}"
        )
    rms = result["torque_rms_nm"]
    yield f"torque rms    {rms['measured']:.4f} measured, {rms['filtered']:.4f} filtered N m"
    yield from remark_lines(result)


def doubts_of(result: Mapping[str, Any]) -> list[str]:
    """Return every reason to doubt a result: what the run saw and what its data show."""
    flags = [str(flag["detail"]) for flag in result.get("flags", ())]
    return [*map(str, result.get("doubts", ())), *flags]


LINES = {
    "calibration": calibration_lines,
    "misalignment": misalignment_lines,
    "ripple": ripple_lines,
}


def failed(kind: str, result: Mapping[str, Any]) -> str | None:
    """Return why a result does not pass, or None; any doubt fails a run with motion."""
    if kind == "calibration":
        return calibration_failed(result)
    return "; ".join(doubts_of(result)) or None
