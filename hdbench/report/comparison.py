"""Page of a comparison of two results: verdict, overlay, numbers, what else differs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.report.canvas import new_figure, score_chart
from hdbench.report.numbers import DASH, first_up, plain, short, unit_words
from hdbench.report.page import ReportFiles, numbers_csv, page_files, write_page
from hdbench.report.pagemodel import KeyNumber, Picture, Section, Table, Verdict
from hdbench.report.texts import summary

_ANSWERS = {
    "within-uncertainty": "Within its uncertainty",
    "moved": "Moved",
    "cannot-tell": "Cannot tell",
}
_TITLES = {
    "calibration": "Two calibrations compared",
    "misalignment": "Misalignment before and after",
    "ripple": "Torque ripple of two runs compared",
    "diagnosis": "Two diagnoses compared",
}


def write_comparison(body: Mapping[str, Any], out: Path) -> ReportFiles:
    """Write a comparison as one offline page, its numbers as CSV, and all of it as JSON."""
    files = page_files(out, option="--html", example="compare.html")
    name = f"{body['a']['run_id']} (A) and {body['b']['run_id']} (B)"
    numbers = tuple(_numbers(body["quantities"], name))
    section = Section(
        name,
        "comparison",
        _TITLES[body["kind"]],
        Verdict(
            "good" if body["verdict"] == "within-uncertainty" else "look",
            f"{_ANSWERS[body['verdict']]}. {first_up(body['sentence'])}.",
        ),
        tuple(_doubts(body)),
        summary("comparison", body),
        numbers,
        tuple(_pictures(body)),
        tuple(_tables(body)),
        tuple(_provenance(body)),
    )
    table = numbers_csv((number.quantity, number) for number in numbers)
    return write_page(files, (section,), table, body)


def _doubts(body: Mapping[str, Any]) -> Iterator[str]:
    for side in ("a", "b"):
        one = body[side]
        words = [*one["doubts"], *one["flags"]]
        if one["status"] not in (None, "complete"):
            words.append(f"the run is {one['status']}")
        if words:
            yield f"{side.upper()}: {'; '.join(words)}."


def _numbers(rows: Sequence[Mapping[str, Any]], source: str) -> Iterator[KeyNumber]:
    for row in rows:
        step, name = row["difference"], row["name"]
        if step is not None:
            yield KeyNumber(
                f"{row['label']}, B less A",
                f"{name}.difference",
                float(step["value"]),
                row["unit"],
                f"{source}: {name}",
                step["std"],
                step["dof"],
                row["note"],
            )


def _tables(body: Mapping[str, Any]) -> Iterator[Table]:
    answers = {True: "moved", False: "within", None: DASH}
    yield Table.told("compared", body["quantities"], answers=answers)
    orders = body["orders"]
    if orders is not None:
        joint = orders["score"]
        note = "" if joint is None else f"all orders together: score {joint:.2f}"
        yield Table.told("vectors", orders["orders"], note)
    for key, title in (
        ("profile_changes", "Profile keys that differ"),
        ("environment_changes", "What else differs"),
    ):
        changes = body[key]
        note = "" if changes else "nothing differs"
        if changes is None:
            note = "not known: a result file alone does not tell"
        yield Table.told("changes", changes or (), note, title=title)


def _provenance(body: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "hdbench", str(body["hdbench_version"])
    yield "confidence", plain(body["confidence"])
    for side in ("a", "b"):
        for name, key in (("", "path"), (" measured", "measured_utc"), (" profile", "profile")):
            yield f"{side.upper()}{name}", re.sub(r"\s+", " ", plain(body[side][key]))


def _pictures(body: Mapping[str, Any]) -> Iterator[Picture]:
    if body["overlay"] is not None:
        yield _overlay(body["overlay"], dots=body["kind"] == "calibration")
    told = [row for row in body["quantities"] if row["score"] is not None]
    if told:
        yield _scores(told)


def _overlay(curves: Mapping[str, Any], *, dots: bool) -> Picture:
    figure, (axes,) = new_figure(1, 3.0)
    # B dashed: two curves that agree are both seen
    for side, colour, line in (("a", "before", "-"), ("b", "filtered", "--")):
        x, y = (np.array(curves[side][key]) for key in ("x", "y"))
        if dots:
            style = {"markersize": 4.0, "label": side.upper()}
            axes.points(x, y, colour, filled=side == "b", **style)
        else:
            axes.curve(x, y, colour, line, label=side.upper())
    words = [f"{curves[k]['label']} ({unit_words(curves[k]['unit'])})" for k in ("x", "y")]
    axes.label(words[0], words[1])
    axes.legend_above()
    curve = f"{words[1]} over {words[0]}"
    a, b = (float(np.ptp(np.array(curves[side]["y"]))) for side in ("a", "b"))
    shown = {"shown_a": short(a), "shown_b": short(b), "Curve": first_up(curve)}
    return Picture.drawn(figure, "overlay", "overlay", curve=curve, a=a, b=b, **shown)


def _scores(told: Sequence[Mapping[str, Any]]) -> Picture:
    rows = [(row["label"], float(row["score"]), bool(row["decides"])) for row in told]
    figure = score_chart(rows, "difference over its expanded uncertainty")
    scores = "; ".join(f"{name} {score:.2f}" for name, score, _ in rows)
    return Picture.drawn(figure, "scores", "scores", scores=scores)
