"""`hdbench runs compare`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hdbench.comparison import compare_runs, comparison_csv
from hdbench.errors import LimitError
from hdbench.records import write_atomic
from hdbench_cli.inputs import refuse_same_csv
from hdbench_cli.output import Output
from hdbench_cli.text import Lines, styled, table, with_uncertainty

_ANSWERS = {
    "moved": ("MOVED", "bold red"),
    "within-uncertainty": ("within uncertainty", "green"),
    "cannot-tell": ("cannot tell", "yellow"),
}
# keys shown on the screen: the rest is in --json
_MOST_KEYS = 8


def compare_command(
    output: Output,
    a: Path,
    b: Path,
    same_origin: bool,
    independent: bool,
    confidence: float,
    check: bool,
    csv_file: Path | None,
    html_file: Path | None,
) -> None:
    """Compare two runs of one kind: B minus A, in units of its uncertainty."""
    refuse_same_csv(csv_file, html_file)
    found = compare_runs(
        a, b, confidence=confidence, same_origin=same_origin, independent=independent
    )
    body = found.to_dict()
    files: dict[str, str] = {}
    if csv_file is not None:
        write_atomic(csv_file, comparison_csv(found).encode())
        files["csv"] = str(csv_file)
    if html_file is not None:
        from hdbench.report.comparison import write_comparison

        files["html"] = str(write_comparison(body, html_file).html)
    body["files"] = files
    output.result(body, _lines(body))
    if check and found.verdict != "within-uncertainty":
        output.end(
            LimitError(
                f"{body['verdict'].replace('-', ' ')}: {body['sentence']}",
                where=f"{body['a']['path']}, {body['b']['path']}",
                fix="look at the differences of profile and environment, then measure again",
            )
        )


def _lines(body: Mapping[str, Any]) -> Lines:
    """Yield a comparison on one screen."""
    word, style = _ANSWERS[body["verdict"]]
    yield styled((f"{word}  ", style), body["sentence"])
    for side in ("a", "b"):
        one = body[side]
        when = f", measured {one['measured_utc'][:19]}Z" if one["measured_utc"] else ""
        doubts = [*one["doubts"], *one["flags"]]
        doubtful = f", doubtful: {'; '.join(doubts)}" if doubts else ""
        yield f"{side.upper()}  {one['run_id']}{when}{doubtful}"
    yield from _quantities(body["quantities"])
    if body["orders"] is not None:
        yield from _orders(body["orders"])
    for name in ("only_a", "only_b"):
        if body[name]:
            yield f"only in {name[-1].upper()}: {', '.join(body[name])}"
    yield f"common     {body['assumption']}"
    yield from _changes("profile", body["profile_changes"])
    yield from _changes("around it", body["environment_changes"])
    yield from (f"{name:10} {path}" for name, path in body["files"].items())


def _number(body: Any) -> str:
    if body is None:
        return "-"
    if not isinstance(body, Mapping):
        return f"{body:.4g}"
    return with_uncertainty({**body, "dof": None}, "").strip()


def _quantities(rows: list[dict[str, Any]]) -> Lines:
    cells = []
    for row in rows:
        score = row["score"]
        told = "" if score is None else f"{score:.2f}{' !' if row['moved'] else ''}"
        label = row["label"] + (f" ({row['unit']})" if row["unit"] else "")
        expanded = "" if row["expanded"] is None else f"{row['expanded']:.2g}"
        change = "" if row["difference"] is None else f"{row['difference']['value']:+.4g}"
        words = (label, _number(row["a"]), _number(row["b"]), change, expanded, told)
        cells.append([styled((word, "" if row["decides"] else "dim")) for word in words])
    yield table(("", "A", "B", "B - A", "expanded", "score"), cells)
    score = "score: |B - A| over its expanded uncertainty; above 1 (!) it has moved"
    yield styled((f"{score}; dim: for information", "dim"))


def _orders(orders: Mapping[str, Any]) -> Iterator[str]:
    if orders["score"] is None and len(orders["orders"]) == 1:
        yield (
            "vectors    phase not compared: the angle has no common origin "
            "(--same-origin says it has)"
        )
        return
    how = "one angle origin"
    if not orders["same_origin"]:
        how = f"B turned back by {orders['shift_rad']:.4f} rad: no common angle origin is known"
    yield f"vectors    {how}"
    for row in orders["orders"]:
        told = "" if row["score"] is None else f", score {row['score']:.2f}"
        step = _number(row["difference"]["amplitude_nm"])
        yield f"  order {row['order']:g}: difference {step} N m{told}"
    if orders["score"] is not None:
        yield f"  together: score {orders['score']:.2f}{' !' if orders['moved'] else ''}"


def _changes(name: str, changes: list[dict[str, Any]] | None) -> Iterator[str]:
    if changes is None:
        yield f"{name:10} not known: a result file alone does not tell"
        return
    if not changes:
        yield f"{name:10} the same"
    for index, change in enumerate(changes[:_MOST_KEYS]):
        head = name if index == 0 else ""
        a, b = ("absent" if change["only"] not in ("", s) else change[s] for s in "ab")
        yield f"{head:10} {change['key']}: {a!s:.40} -> {b!s:.40}"
    if len(changes) > _MOST_KEYS:
        yield f"{'':10} and {len(changes) - _MOST_KEYS} more: see --json"
