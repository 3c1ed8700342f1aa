"""The page of a fleet: key figures over drives, outliers, causes, and a way to every report."""

from __future__ import annotations

import math
import os
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from markupsafe import Markup
from scipy.stats import beta, binom

from hdbench.batch import read_table
from hdbench.errors import DataError, HdbenchError
from hdbench.records import FloatArray, read_json
from hdbench.records.jsonfile import result_header
from hdbench.report.canvas import COLOURS, draw_svg, label_axes, new_figure
from hdbench.report.elements import KeyNumber, Picture, ReportFiles, Section, Table, Verdict
from hdbench.report.figures import KINDS, key_figures
from hdbench.report.numbers import DASH, short, unit_words
from hdbench.report.page import PageWords, render_page
from hdbench.report.pagefiles import csv_text, is_page, page_files, write_page

__all__ = ["FleetRun", "fleet_runs", "outlier_limit", "write_fleet"]

# chance that a page names any outlier among drives of one kind that scatter normally
FALSE_ALARM = 0.05
# with fewer drives a median and its scatter say too little to judge one of them
LEAST_DRIVES = 8
_DRAWS, _SEED = 20_000, 0
# draws at a time: 1 000 drives take 8 MB
_AT_ONCE = 1_000
# a phase has no order, and these say how the bench was run
_NOT_OF_THE_DRIVE = ("phase", "motor_velocity", "n_experiments", "output_turns")
_LEVELS = {"good": "in order", "look": "look", "bad": "not usable"}
_MOST_COLUMNS, _MOST_PICTURES = 6, 12
_CSV_HEAD = ("kind", "drive", "run", "figure", "value", "std", "score", "outlier")
_SCATTER = 1.4826  # of a normal law: standard deviation over median absolute deviation
_RULE = (
    f"A drive is an outlier in a figure when it lies further from the median of all drives than "
    f"chance explains: the limit, in robust standard deviations ({_SCATTER} times the median "
    f"absolute deviation), is set by {_DRAWS} simulated fleets of the same size, so that a fleet "
    f"of normally scattered drives has with {FALSE_ALARM:.0%} probability any outlier in any "
    "figure of its kind. Figures with a long tail name more. An uncertainty that is larger than "
    "that of most drives widens the limit for its drive. Of several runs of a drive the newest "
    "counts."
)


@dataclass(frozen=True, slots=True)
class FleetRun:
    """One run of one drive.

    Parameters
    ----------
    drive : str
        Identity of the drive; the name of the run where none is known.
    path : Path
        Run folder, or file of a result.
    result : mapping
        The result; empty where there is none.
    kind, started_utc : str
        Kind of the result, and when the run started.
    error : str
        Why there is no result.
    """

    drive: str
    path: Path
    result: Mapping[str, Any]
    kind: str = ""
    started_utc: str = ""
    error: str = ""


@dataclass(frozen=True, slots=True)
class _Figure:
    """One key figure over the drives of a kind."""

    name: str
    label: str
    unit: str
    values: FloatArray
    stds: FloatArray
    scores: FloatArray
    limit: float
    median: float
    scatter: float

    @property
    def outliers(self) -> Any:
        return np.abs(self.scores) > self.limit

    def far(self) -> list[int]:
        """Return the places of the outliers among the drives."""
        return [int(k) for k in np.flatnonzero(self.outliers)]


def fleet_runs(named: Sequence[Path]) -> list[FleetRun]:
    """Return the runs of a fleet."""
    return [run for path in named for run in _runs_in(Path(path))]


def _runs_in(path: Path) -> Iterator[FleetRun]:
    if (path / "batch.jsonl").is_file():
        for row in read_table(path):
            name = Path(str(row["result"] or row["input"])).name
            drive = str(row.get("drive") or "") or Path(name).name.partition(".")[0]
            if row["result"] is None:
                yield FleetRun(drive, Path(str(row["input"])), {}, error=str(row["error"]))
            else:
                yield _run(path / "results" / name, drive)
    elif (path / "run.json").is_file():
        yield _run(path, "")
    else:
        runs = sorted(path.glob("*/run.json")) if path.is_dir() else []
        if not runs:
            raise DataError(
                "no batch and no run", where=str(path), fix="name a folder of a batch or of runs"
            )
        yield from (_run(run.parent, "") for run in runs)


def _run(path: Path, drive: str) -> FleetRun:
    try:
        manifest = read_json(path / "run.json") if path.is_dir() else {}
        file = path / "result.json" if path.is_dir() else path.with_name(
            f"{path.name.partition('.')[0]}.result.json"
        )  # fmt: skip
        result = read_json(file)
    except HdbenchError as error:
        return FleetRun(drive or path.name, path, {}, error=f"{error.where}: {error.what}")
    named = manifest.get("drive")
    known = drive or (named if isinstance(named, str) and named else path.name)
    kind = str(result.get("schema", "")).removeprefix("hdbench/").partition("/")[0]
    return FleetRun(known, path, result, kind, str(manifest.get("started_utc") or ""))


def _newest(runs: Iterable[FleetRun]) -> list[FleetRun]:
    """Return of every drive its newest run."""
    found: dict[str, FleetRun] = {}
    for run in sorted(runs, key=lambda run: run.started_utc):
        found[run.drive] = run
    return sorted(found.values(), key=lambda run: run.drive)


@cache
def outlier_limit(count: int, chance: float) -> float:
    """Return how far a drive may lie from the median, in robust standard deviations."""
    rng = np.random.default_rng(_SEED)
    farthest = []
    for _ in range(_DRAWS // _AT_ONCE):
        drawn = rng.standard_normal((_AT_ONCE, count))
        away = np.abs(drawn - np.median(drawn, axis=1, keepdims=True))
        farthest.append(away.max(axis=1) / (_SCATTER * np.median(away, axis=1)))
    return float(np.quantile(np.concatenate(farthest), 1.0 - chance))


def _figures(runs: Sequence[FleetRun]) -> list[_Figure]:
    """Return the key figures that enough drives have, with the score of every drive."""
    numbers = [{n.quantity: n for n in key_figures(run.result)} for run in runs]
    counts = Counter(name for found in numbers for name in found)
    labels: dict[str, KeyNumber] = {}
    for found in numbers:
        labels = {**found, **labels}
    names = [
        name
        for name in labels
        if counts[name] >= LEAST_DRIVES and not any(w in name for w in _NOT_OF_THE_DRIVE)
    ]
    if not names:
        return []
    chance = 1.0 - (1.0 - FALSE_ALARM) ** (1.0 / len(names))
    return [_figure(labels[name], numbers, chance) for name in names]


def _figure(label: KeyNumber, numbers: Sequence[Mapping[str, KeyNumber]], chance: float) -> _Figure:
    name = label.quantity
    values = np.array([n[name].value if name in n else math.nan for n in numbers])
    stds = np.array([(n[name].std or 0.0) if name in n else math.nan for n in numbers])
    median = float(np.nanmedian(values))
    scatter = _SCATTER * float(np.nanmedian(np.abs(values - median)))
    more = np.maximum(stds**2 - np.nanmedian(stds**2), 0.0)
    size = np.sqrt(scatter**2 + more)
    # where more than half of the drives agree to the last digit nothing tells what is far
    scores = np.divide(values - median, size, out=np.zeros_like(values), where=size > 0.0)
    scores[np.isnan(values)] = math.nan
    limit = outlier_limit(int(np.count_nonzero(np.isfinite(values))), chance)
    words = label.label.partition(", 95 %")[0]
    return _Figure(name, words, label.unit, values, stds, scores, limit, median, scatter)


def write_fleet(runs: Sequence[FleetRun], out: Path) -> ReportFiles:
    """Write the page of a fleet, with every number as CSV and JSON beside it."""
    kinds: dict[str, list[FleetRun]] = defaultdict(list)
    for run in runs:
        if run.result:
            kinds[run.kind].append(run)
    if not kinds:
        raise DataError(
            f"none of {len(runs)} runs has a result",
            where="report --fleet",
            fix="look at the column error of the batch",
        )
    files = page_files(out if is_page(out) else out / "fleet.html")
    sections: list[Section] = []
    cells: list[tuple[object, ...]] = []
    body: dict[str, Any] = {}
    lost = [run for run in runs if not run.result]
    for kind, some in sorted(kinds.items(), key=lambda entry: _place(entry[0])):
        newest = _newest(some)
        figures = _figures(newest)
        sections.append(_section(kind, newest, figures, lost if not sections else [], files))
        cells += list(_cells(kind, newest, figures))
        body[kind] = _as_json(newest, figures)
    words = PageWords("Fleet", "kinds of results", _RULE)
    header = result_header("fleet", None)
    return write_page(
        files,
        render_page(sections, files, words),
        csv_text(_CSV_HEAD, cells),
        {**header, "false_alarm_probability": FALSE_ALARM, "kinds": body},
    )


def _place(kind: str) -> tuple[int, str]:
    """Return where a kind stands on the page: in the order of the bench's work."""
    return ([*KINDS, kind].index(kind), kind)


def _section(
    kind: str,
    runs: Sequence[FleetRun],
    figures: Sequence[_Figure],
    lost: Sequence[FleetRun],
    files: ReportFiles,
) -> Section:
    far = np.any([figure.outliers for figure in figures], axis=0) if figures else np.zeros(0, bool)
    count = int(np.count_nonzero(far))
    judged = f"{count} of {len(runs)} drives are outliers" if figures else "No drive is judged"
    text = f"{judged}; {len(lost)} inputs have no result." if lost else f"{judged}."
    notes = () if figures else (f"Needed: {LEAST_DRIVES} drives that have the same figure.",)
    tables = [
        _outlier_table(runs, figures, files),
        _figure_table(figures),
        _cause_table(runs),
        _drive_table(kind, runs, figures, far, files),
        _lost_table(lost),
    ]
    return Section(
        f"{len(runs)} drives",
        kind,
        f"{kind.capitalize()} of {len(runs)} drives",
        Verdict("look" if count or lost else "good", text, notes),
        (),
        "",
        (),
        tuple(_picture(f, kind, k) for k, f in enumerate(figures[:_MOST_PICTURES])),
        tuple(table for table in tables if table is not None and table.rows),
        (),
        (),
    )


def _link(run: FleetRun, files: ReportFiles) -> str:
    """Return the drive as a link to its own report, else to its result."""
    own = [run.path / name for name in ("report.html", "result.json")]
    target = next((file for file in own if file.is_file()), run.path)
    place = os.path.relpath(target.resolve(), files.html.resolve().parent)
    link = Markup('<a href="{}" style="white-space: nowrap">{}</a>')
    return link.format(quote(Path(place).as_posix()), run.drive)


def _told(value: float, std: float) -> str:
    if not math.isfinite(value):
        return DASH
    return f"{short(value, std)} ± {short(std, std)}" if std > 0.0 else short(value)


def _named(figure: _Figure) -> str:
    return f"{figure.label}, {unit_words(figure.unit)}" if figure.unit else figure.label


def _outlier_table(
    runs: Sequence[FleetRun], figures: Sequence[_Figure], files: ReportFiles
) -> Table:
    found = [(abs(figure.scores[k]), k, figure) for figure in figures for k in figure.far()]
    rows = tuple(
        (
            _link(runs[k], files),
            _named(figure),
            _told(figure.values[k], figure.stds[k]),
            f"{figure.scores[k]:+.1f}".replace("-", "\N{MINUS SIGN}"),
            f"{figure.limit:.1f}",
        )
        for _, k, figure in sorted(found, key=lambda entry: -entry[0])
    )
    head = ("drive", "figure", "value ± standard uncertainty", "robust deviations", "limit")
    return Table("Outliers, farthest first", head, rows, wide=True)


def _figure_table(figures: Sequence[_Figure]) -> Table:
    rows = []
    for figure in figures:
        known = np.sort(figure.values[np.isfinite(figure.values)])
        low, high = _median_interval(known)
        room = figure.limit * figure.scatter
        rows.append(
            (
                _named(figure),
                str(known.size),
                f"{short(figure.median, figure.scatter)} ({short(low, figure.scatter)} to "
                f"{short(high, figure.scatter)})",
                short(figure.scatter),
                f"{short(figure.median - room, room)} to {short(figure.median + room, room)}"
                if room
                else DASH,
                str(int(np.count_nonzero(figure.outliers))) if room else DASH,
            )
        )
    head = ("figure", "drives", "median (95 % interval)", "robust scatter", "limits", "outliers")
    note = "Where most drives agree to the last digit the scatter is 0, and none is judged."
    alike = any(figure.scatter == 0.0 for figure in figures)
    return Table("Key figures over drives", head, tuple(rows), note if alike else "", wide=True)


def _median_interval(ordered: FloatArray) -> tuple[float, float]:
    """Return the 95 % interval of a median from order statistics (binomial law)."""
    below = int(binom.ppf(0.025, ordered.size, 0.5))
    return float(ordered[max(below - 1, 0)]), float(
        ordered[min(ordered.size - below, ordered.size - 1)]
    )


def _cause_table(runs: Sequence[FleetRun]) -> Table | None:
    told = [run.result["causes"] for run in runs if isinstance(run.result.get("causes"), list)]
    if not told:
        return None
    counts = Counter(name for causes in told for name in {cause["name"] for cause in causes})
    rows = []
    for name, count in counts.most_common():
        low = float(beta.ppf(0.025, count, len(told) - count + 1))
        high = float(beta.ppf(0.975, count + 1, len(told) - count)) if count < len(told) else 1.0
        share = f"{count / len(told):.1%} ({low:.1%} to {high:.1%})"
        rows.append((name, str(count), share))
    title = f"Causes by frequency, of {len(told)} drives"
    return Table(title, ("cause", "drives", "share (95 % interval)"), tuple(rows))


def _drive_table(
    kind: str,
    runs: Sequence[FleetRun],
    figures: Sequence[_Figure],
    far: Any,
    files: ReportFiles,
) -> Table:
    shown = figures[:_MOST_COLUMNS]
    module = KINDS.get(kind)
    rows = []
    for k, run in enumerate(runs):
        names = run.result.get("causes")
        verdict = _LEVELS[module.verdict(run.result).level] if module else DASH
        if isinstance(names, list):
            verdict = ", ".join(cause["name"] for cause in names) or "nothing found"
        cells = [_told(f.values[k], f.stds[k]) + (" ▲" if f.outliers[k] else "") for f in shown]
        rows.append((_link(run, files), *cells, verdict))
    order = sorted(range(len(runs)), key=lambda k: (not (far.size and far[k]), runs[k].drive))
    head = ("drive", *map(_named, shown), "causes" if kind == "diagnosis" else "verdict")
    note = "▲ marks an outlier; outliers stand first. The link leads to the drive's own report."
    if len(figures) > len(shown):
        note += f" The CSV file has the other {len(figures) - len(shown)} figures."
    return Table("Drives", head, tuple(rows[k] for k in order), note, wide=True)


def _lost_table(lost: Sequence[FleetRun]) -> Table:
    rows = tuple((run.drive, run.error) for run in lost)
    return Table("Inputs without a result", ("drive or input", "why"), rows)


def _picture(figure: _Figure, kind: str, number: int) -> Picture:
    known = figure.values[np.isfinite(figure.values)]
    drawing, (axes,) = new_figure(1, 2.2)
    axes.hist(known, bins="auto" if known.size < 200 else 40, color=COLOURS["measured"])
    axes.axvline(figure.median, color=COLOURS["expected"])
    room = figure.limit * figure.scatter
    for end in (figure.median - room, figure.median + room):
        axes.axvline(end, color=COLOURS["expected"], linestyle="--")
    far = figure.values[figure.outliers]
    axes.plot(far, np.zeros(far.size), "^", color=COLOURS["filtered"], clip_on=False)
    label_axes(axes, _named(figure), "drives")
    caption = f"{known.size} drives; line: median, dashed: limits" + (
        f", triangles: {far.size} outliers." if far.size else "."
    )
    alt = f"{figure.label}: {caption} Median {short(figure.median, figure.scatter)}."
    return Picture(figure.label, caption, alt, draw_svg(drawing, f"fleet-{kind}-{number}", alt))


def _cells(
    kind: str, runs: Sequence[FleetRun], figures: Sequence[_Figure]
) -> Iterator[tuple[object, ...]]:
    for figure in figures:
        for k, run in enumerate(runs):
            if math.isnan(figure.values[k]):
                continue
            std = repr(float(figure.stds[k])) if figure.stds[k] else ""
            yield (kind, run.drive, str(run.path), figure.name,
                   repr(float(figure.values[k])), std, f"{figure.scores[k]:.4g}",
                   bool(figure.outliers[k]))  # fmt: skip


def _as_json(runs: Sequence[FleetRun], figures: Sequence[_Figure]) -> dict[str, Any]:
    return {
        "drives": [{"drive": run.drive, "run": str(run.path)} for run in runs],
        "figures": [
            {
                "figure": figure.name,
                "unit": figure.unit,
                "drives": int(np.count_nonzero(np.isfinite(figure.values))),
                "median": figure.median,
                "robust_scatter": figure.scatter,
                "limit_robust_deviations": figure.limit,
                "outliers": [runs[k].drive for k in figure.far()],
            }
            for figure in figures
        ],
    }
