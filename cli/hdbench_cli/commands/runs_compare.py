"""`hdbench runs compare`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["compare"]

_ANSWERS = {
    "moved": ("MOVED", "bold red"),
    "within-uncertainty": ("within uncertainty", "green"),
    "cannot-tell": ("cannot tell", "yellow"),
}
# keys shown on the screen: the rest is in --json
_MOST_KEYS = 8


@click.command(
    "compare", epilog="Example: hdbench runs compare runs/BEFORE runs/AFTER --html c.html"
)
@click.argument("a", metavar="A", type=click.Path(path_type=Path))
@click.argument("b", metavar="B", type=click.Path(path_type=Path))
@click.option("--same-origin", is_flag=True,
              help="Angle 0 is one mark on the shaft in both runs: phases count.")  # fmt: skip
@click.option("--independent", is_flag=True,
              help="Take no standard and no gain as common to both.")  # fmt: skip
@click.option("--confidence", type=float, default=0.95, show_default=True,
              help="Of the verdict, all that decides taken together.")  # fmt: skip
@click.option("--check", is_flag=True, help="Exit 3 unless all is within its uncertainty.")
@click.option("--csv", "csv_file", metavar="FILE.csv", help="The quantities as CSV.",
              type=click.Path(path_type=Path, dir_okay=False))  # fmt: skip
@click.option("--html", "html_file", metavar="FILE.html",
              help="One offline page with an overlay; CSV and JSON go beside it.",
              type=click.Path(path_type=Path, dir_okay=False))  # fmt: skip
@click.pass_obj
def compare(
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
    """Hold two runs of one kind against each other: B less A, in units of its uncertainty.

    A and B are run folders or result files. Numbers with their differences, orders as vectors, and
    what differs in profile, versions, device and calibration. What both have in common, such as one
    gain or the same weights, does not count as a difference.
    """
    from hdbench.comparison import compare_runs, comparison_csv
    from hdbench.errors import UsageError
    from hdbench.records import write_atomic

    if csv_file and html_file and csv_file.resolve() == html_file.with_suffix(".csv").resolve():
        raise UsageError(
            f"{csv_file} is also the name of the page's own CSV file",
            where="--csv",
            fix="give --csv another name than --html",
        )
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
    output.result(body, lambda console: show(console, body))
    if check and found.verdict != "within-uncertainty":
        _failed(output, body)


def _failed(output: Output, body: Mapping[str, Any]) -> None:
    from hdbench.errors import LimitError

    error = LimitError(
        f"{body['verdict'].replace('-', ' ')}: {body['sentence']}",
        where=f"{body['a']['path']}, {body['b']['path']}",
        fix="look at the differences of profile and environment, then measure again",
    )
    if not output.json:
        raise error
    output.note(str(error))
    raise click.exceptions.Exit(error.exit_code)


def show(console: Console, body: Mapping[str, Any]) -> None:
    """Draw a comparison on one screen."""
    from rich.text import Text

    word, style = _ANSWERS[body["verdict"]]
    console.print(Text.assemble((f"{word}  ", style), body["sentence"]), soft_wrap=True)
    for side in ("a", "b"):
        one = body[side]
        when = f", measured {one['measured_utc'][:19]}Z" if one["measured_utc"] else ""
        doubts = f", doubtful: {'; '.join([*one['doubts'], *one['flags']])}" if _doubt(one) else ""
        console.print(Text(f"{side.upper()}  {one['run_id']}{when}{doubts}"), soft_wrap=True)
    _show_quantities(console, body["quantities"])
    if body["orders"] is not None:
        _show_orders(console, body["orders"])
    for name in ("only_a", "only_b"):
        if body[name]:
            text = f"only in {name[-1].upper()}: {', '.join(body[name])}"
            console.print(Text(text), soft_wrap=True)
    console.print(Text(f"common     {body['assumption']}"), soft_wrap=True)
    _show_changes(console, "profile", body["profile_changes"])
    _show_changes(console, "around it", body["environment_changes"])
    for name, path in body["files"].items():
        console.print(Text(f"{name:10} {path}"), soft_wrap=True)


def _doubt(side: Mapping[str, Any]) -> bool:
    return bool(side["doubts"] or side["flags"])


def _pair(body: Any) -> str:
    if body is None:
        return "-"
    if not isinstance(body, Mapping):
        return f"{body:.4g}"
    from hdbench_cli.numbers import with_uncertainty

    return with_uncertainty({**body, "dof": None}, "").strip()


def _show_quantities(console: Console, rows: list[dict[str, Any]]) -> None:
    from rich.table import Table

    table = Table("", "A", "B", "B - A", "expanded", "score", box=None, pad_edge=False)
    for row in rows:
        score = row["score"]
        told = "" if score is None else f"{score:.2f}{' !' if row['moved'] else ''}"
        label = row["label"] + (f" ({row['unit']})" if row["unit"] else "")
        expanded = "" if row["expanded"] is None else f"{row['expanded']:.2g}"
        change = "" if row["difference"] is None else f"{row['difference']['value']:+.4g}"
        cells = (_pair(row["a"]), _pair(row["b"]), change, expanded, told)
        table.add_row(label, *cells, style=None if row["decides"] else "dim")
    console.print(table)
    console.print("score: |B - A| over its expanded uncertainty; above 1 (!) it has moved; "
                  "dim: for information", style="dim", soft_wrap=True)  # fmt: skip


def _show_orders(console: Console, orders: Mapping[str, Any]) -> None:
    from rich.text import Text

    if orders["score"] is None and len(orders["orders"]) == 1:
        text = "phase not compared: the angle has no common origin (--same-origin says it has)"
        console.print(Text(f"vectors    {text}"), soft_wrap=True)
        return
    how = "one angle origin"
    if not orders["same_origin"]:
        how = f"B turned back by {orders['shift_rad']:.4f} rad: no common angle origin is known"
    console.print(Text(f"vectors    {how}"), soft_wrap=True)
    for row in orders["orders"]:
        step = row["difference"]["amplitude_nm"]
        told = "" if row["score"] is None else f", score {row['score']:.2f}"
        text = f"  order {row['order']:g}: difference {_pair(step)} N m{told}"
        console.print(Text(text), soft_wrap=True)
    if orders["score"] is not None:
        text = f"  together: score {orders['score']:.2f}{' !' if orders['moved'] else ''}"
        console.print(Text(text), soft_wrap=True)


def _show_changes(console: Console, name: str, changes: list[dict[str, Any]] | None) -> None:
    from rich.text import Text

    if changes is None:
        text = "not known: a result file alone does not tell"
        console.print(Text(f"{name:10} {text}"), soft_wrap=True)
        return
    if not changes:
        console.print(Text(f"{name:10} the same"), soft_wrap=True)
    for index, change in enumerate(changes[:_MOST_KEYS]):
        head = name if index == 0 else ""
        a, b = ("absent" if change["only"] not in ("", s) else change[s] for s in "ab")
        console.print(Text(f"{head:10} {change['key']}: {a!s:.40} -> {b!s:.40}"), soft_wrap=True)
    if len(changes) > _MOST_KEYS:
        console.print(f"{'':10} and {len(changes) - _MOST_KEYS} more: see --json")
