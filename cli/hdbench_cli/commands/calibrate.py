"""`hdbench calibrate`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hdbench_cli.commands.experiment import Request, run
from hdbench_cli.options import EXPERIMENT, declared
from hdbench_cli.output import Output
from hdbench_cli.text import remark_lines, table, with_uncertainty

if TYPE_CHECKING:
    from rich.console import RenderableType

_ACCEPTED = {True: "yes", False: "no", None: "not decided"}
_OF = (
    ("mean_of_positions", "mean of positions"),
    ("any_one_position", "any one position"),
    ("naive", "were all experiments independent"),
)


def lines(result: Mapping[str, Any]) -> Iterator[RenderableType]:
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
    yield from summary(result)
    yield from remark_lines(result)


def summary(result: Mapping[str, Any]) -> Iterator[str]:
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


def failed(result: Mapping[str, Any]) -> str | None:
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


@declared("calibrate", f"{EXPERIMENT} preset who mistakes")
def command(output: Output, /, **options: Any) -> None:
    """Calibrate the torque sensor by arm and weights with locked wave generator.

    Positions, directions and load ranges come from the profile; each is loaded and unloaded. The
    drive stays disabled; an encoder that moves stops the experiment. Every accepted reading is
    kept at once: after a stop or a crash, hdbench runs resume goes on at the next weight.
    """
    run(output, Request("calibration", **options))
