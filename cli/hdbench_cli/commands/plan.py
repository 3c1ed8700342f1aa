"""`hdbench plan`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hdbench.diagnosis.planning import plan_report, write_plan
from hdbench.errors import UsageError
from hdbench_cli.inputs import choose_profile
from hdbench_cli.output import Output, progress_bar
from hdbench_cli.text import Lines, styled

# lines of each table that fit one screen together with the rest
_SHOWN, _SETTLED = 8, 2


def plan_command(
    output: Output,
    /,
    profile_name: str | None,
    of: Path | None,
    result: Path | None,
    no_loads: bool,
    out: Path | None,
    **asked: Any,
) -> None:
    """Say which run separates which causes."""
    profile = choose_profile(profile_name, of or result)
    with progress_bar("plan") as told:
        report, plan = plan_report(profile, told, of=of, result=result, loads=not no_loads, **asked)
    if out is not None:
        if plan is None:
            settled = (pair["settled_by"] for pair in report["pairs"] if pair["settled_by"])
            raise UsageError(
                "no run of this bench tells these causes apart; no plan file was written",
                where="hdbench plan --out",
                fix=next(settled, "name other causes, or allow more --duration"),
            )
        write_plan(out, plan)
    command = None if out is None else f"hdbench run-ripple --plan {out}"
    body = {**report, "plan_file": None if out is None else str(out), "command": command}
    output.result(body, _lines(body), kind="plan-report", profile=profile)


def _lines(body: Mapping[str, Any]) -> Lines:
    """Yield the report on one screen."""
    at_hand = body["at_hand"]
    total = len(at_hand["visible"]) + len(at_hand["invisible"])
    yield styled((body["source"], "bold"))
    yield f"  shows {len(at_hand['visible'])} of {total} causes"
    yield from (f"  exactly alike: {', '.join(one)}" for one in at_hand["inseparable"][:_SHOWN])
    shown = body["pairs"][:_SHOWN]
    if shown:
        head = "share of the first that the second cannot imitate: at hand -> proposed"
        yield styled((head, "bold"))
    for pair in shown:
        mark = "told apart" if pair["separated"] else "NOT told apart"
        yield (
            f"  {pair['first'] + ' / ' + pair['second']:<54}"
            f"{_share(pair['sin2_at_hand'])} -> {_share(pair['sin2_proposed'])}  {mark}"
        )
    if len(body["pairs"]) > _SHOWN:
        open_pairs = sum(not pair["separated"] for pair in body["pairs"])
        yield f"  {len(body['pairs'])} pairs in all, {open_pairs} of them stay open"
    for pair in _open_pairs(body)[:_SETTLED]:
        yield f"  {pair['first']} or {pair['second']} is settled by {pair['settled_by']}"
    if body["plan"] is None:
        yield styled(("no run of this bench tells them apart", "bold"))
        return
    operator = ", needs an operator" if body["needs_operator"] else ""
    yield styled((f"proposed run: {body['duration_s']:.0f} s{operator}", "bold"))
    yield from (f"  {words}" for words in body["words"])
    yield body["command"] or "write it with --out FILE, then hdbench run-ripple --plan FILE"


def _open_pairs(body: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return pairs that stay open, each once whatever its order."""
    found: dict[frozenset[str], dict[str, Any]] = {}
    for pair in body["pairs"]:
        if pair["settled_by"]:
            found.setdefault(frozenset((pair["first"], pair["second"])), pair)
    return list(found.values())


def _share(value: float | None) -> str:
    return "   -" if value is None else f"{value:4.2f}"
