"""Page of a fleet: key figures over drives, outliers, causes, and a way to every report."""

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
from hdbench.records.csvtext import csv_text
from hdbench.records.jsonfile import result_header
from hdbench.report.canvas import COLOURS, new_figure
from hdbench.report.numbers import DASH, MINUS, short, unit_words
from hdbench.report.page import ReportFiles, is_page, page_files, write_page
from hdbench.report.pagemodel import KeyNumber, Picture, Section, Table, Verdict
from hdbench.report.sections import KINDS, key_figures
from hdbench.report.source import typed_result
from hdbench.report.texts import page_text

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


@dataclass(frozen=True, slots=True)
class FleetRun:
    """One run of one drive; `result` is empty where there is none, and `error` says why.

    `drive` is the name of the run where no identity of the drive is known.
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
        """Which drives are outliers."""
        return np.abs(self.scores) > self.limit

    @property
    def title(self) -> str:
        """Name and unit."""
        return f"{self.label}, {unit_words(self.unit)}" if self.unit else self.label

    @property
    def drives(self) -> int:
        """How many drives have it."""
        return int(np.count_nonzero(np.isfinite(self.values)))

    @property
    def ends(self) -> tuple[float, float]:
        """Limits beyond which a drive is an outlier."""
        room = self.limit * self.scatter
        return self.median - room, self.median + room

    def limits(self) -> str:
        """Return both limits in words."""
        return " to ".join(short(end, self.limit * self.scatter) for end in self.ends)

    def score(self, k: int) -> str:
        """Return how far one drive lies from the median, in robust deviations."""
        return f"{self.scores[k]:+.1f}".replace("-", MINUS)

    def far(self) -> list[int]:
        """Return the places of the outliers among the drives."""
        return [int(k) for k in np.flatnonzero(self.outliers)]

    def told(self, k: int) -> str:
        """Return the value of one drive with its standard uncertainty."""
        value, std = self.values[k], self.stds[k]
        if not math.isfinite(value):
            return DASH
        # no line break within a number
        return f"{short(value, std)}\xa0±\xa0{short(std, std)}" if std > 0.0 else short(value)


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
        kind = str(result.get("schema", "")).removeprefix("hdbench/").partition("/")[0]
        typed_result(kind, result, str(file))
    except HdbenchError as error:
        return FleetRun(drive or path.name, path, {}, error=f"{error.where}: {error.what}")
    named = manifest.get("drive")
    known = drive or (named if isinstance(named, str) and named else path.name)
    return FleetRun(known, path, result, kind, str(manifest.get("started_utc") or ""))


def _newest(runs: Iterable[FleetRun]) -> list[FleetRun]:
    """Return of every drive its newest run."""
    newest = {run.drive: run for run in sorted(runs, key=lambda run: run.started_utc)}
    return [newest[drive] for drive in sorted(newest)]


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
    # in the order of the bench's work
    for kind in [*(kind for kind in KINDS if kind in kinds), *sorted(kinds.keys() - KINDS.keys())]:
        newest = _newest(kinds[kind])
        figures = _figures(newest)
        sections.append(_section(kind, newest, figures, [] if sections else lost, files))
        cells += _cells(kind, newest, figures)
        body[kind] = _as_json(newest, figures)
    header = {**result_header("fleet", None), "false_alarm_probability": FALSE_ALARM}
    foot = page_text("fleet_foot", scatter=_SCATTER, draws=_DRAWS, chance=FALSE_ALARM)
    table, words = csv_text(_CSV_HEAD, cells), {"title": "Fleet", "noun": "kinds of results"}
    return write_page(files, sections, table, {**header, "kinds": body}, foot=foot, **words)


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
    return Section(
        f"{kind}, {len(runs)} drives",
        kind,
        f"{kind.capitalize()} of {len(runs)} drives",
        Verdict("look" if count or lost else "good", text, notes),
        pictures=tuple(_picture(f, kind, k) for k, f in enumerate(figures[:_MOST_PICTURES])),
        tables=Table.filled(
            _outlier_table(runs, figures, files),
            _figure_table(figures),
            _cause_table(runs),
            _drive_table(kind, runs, figures, far, files),
            Table.told("fleet_lost", lost),
        ),
    )


def _link(run: FleetRun, files: ReportFiles) -> str:
    """Return the drive as a link to its own report, else to its result."""
    own = [run.path / name for name in ("report.html", "result.json")]
    target = next((file for file in own if file.is_file()), run.path)
    place = os.path.relpath(target.resolve(), files.html.resolve().parent)
    link = Markup('<a href="{}" style="white-space: nowrap">{}</a>')
    return link.format(quote(Path(place).as_posix()), run.drive)


def _outlier_table(
    runs: Sequence[FleetRun], figures: Sequence[_Figure], files: ReportFiles
) -> Table:
    found = [(figure, k) for figure in figures for k in figure.far()]
    found.sort(key=lambda row: -abs(row[0].scores[row[1]]))
    return Table.told(
        "fleet_outliers", found, score=_Figure.score, link=lambda k: _link(runs[k], files)
    )


def _figure_table(figures: Sequence[_Figure]) -> Table:
    note = "Where most drives agree to the last digit the scatter is 0, and none is judged."
    alike = any(figure.scatter == 0.0 for figure in figures)
    return Table.told(
        "fleet_figures", figures, note if alike else "", middle=_middle, limits=_Figure.limits
    )


def _middle(figure: _Figure) -> str:
    """Return a median with its 95 % interval from order statistics (binomial law)."""
    ordered = np.sort(figure.values[np.isfinite(figure.values)])
    below = int(binom.ppf(0.025, ordered.size, 0.5))
    low, high = ordered[max(below - 1, 0)], ordered[min(ordered.size - below, ordered.size - 1)]
    middle, least, most = (short(v, figure.scatter) for v in (figure.median, low, high))
    return f"{middle} ({least} to {most})"


def _cause_table(runs: Sequence[FleetRun]) -> Table:
    told = [run.result["causes"] for run in runs if isinstance(run.result.get("causes"), list)]
    counts = Counter(name for causes in told for name in {cause["name"] for cause in causes})

    def share(count: int) -> str:
        rest = len(told) - count
        low = float(beta.ppf(0.025, count, rest + 1))
        high = float(beta.ppf(0.975, count + 1, rest)) if rest else 1.0
        return f"{count / len(told):.1%} ({low:.1%} to {high:.1%})"

    rows = sorted(counts.items(), key=lambda row: (-row[1], row[0]))
    return Table.told("fleet_causes", rows, count=len(told), share=share)


def _drive_table(
    kind: str,
    runs: Sequence[FleetRun],
    figures: Sequence[_Figure],
    far: Any,
    files: ReportFiles,
) -> Table:
    def verdict(k: int) -> str:
        causes = runs[k].result.get("causes")
        if isinstance(causes, list):
            return ", ".join(cause["name"] for cause in causes) or "nothing found"
        return (
            _LEVELS[KINDS[kind].verdict(typed_result(kind, runs[k].result, "")).level]
            if kind in KINDS
            else DASH
        )

    shown = figures[:_MOST_COLUMNS]
    order = sorted(range(len(runs)), key=lambda k: (not (far.size and far[k]), runs[k].drive))
    note = "▲ marks an outlier; outliers stand first. The link leads to the drive's own report."
    if len(figures) > len(shown):
        note += f" The CSV file has the other {len(figures) - len(shown)} figures."
    head = ("drive", *(f.title for f in shown), "causes" if kind == "diagnosis" else "verdict")
    rows = []
    for k in order:
        cells = [f.told(k) + (" ▲" if f.outliers[k] else "") for f in shown]
        rows.append((_link(runs[k], files), *cells, verdict(k)))
    return Table("Drives", head, tuple(rows), note, wide=True)


def _picture(figure: _Figure, kind: str, number: int) -> Picture:
    known = figure.values[np.isfinite(figure.values)]
    drawing, (axes,) = new_figure(1, 2.2)
    axes.hist(known, bins="auto" if known.size < 200 else 40, color=COLOURS["measured"])
    axes.axvline(figure.median, color=COLOURS["expected"])
    for end in figure.ends:
        axes.axvline(end, color=COLOURS["expected"], linestyle="--")
    far = figure.values[figure.outliers]
    axes.plot(far, np.zeros(far.size), "^", color=COLOURS["filtered"], clip_on=False)
    axes.label(figure.title, "drives")
    outliers = f", triangles: {far.size} outliers" if far.size else ""
    median = short(figure.median, figure.scatter)
    name, numbers = f"fleet-{kind}-{number}", {"drives": known.size, "outliers": outliers}
    return Picture.drawn(drawing, name, "fleet", label=figure.label, median=median, **numbers)


def _cells(
    kind: str, runs: Sequence[FleetRun], figures: Sequence[_Figure]
) -> Iterator[tuple[object, ...]]:
    for figure in figures:
        for k, run in enumerate(runs):
            if math.isnan(figure.values[k]):
                continue
            number, score = (figure.values[k], figure.stds[k] or None), f"{figure.scores[k]:.4g}"
            yield kind, run.drive, run.path, figure.name, *number, score, figure.outliers[k]


def _as_json(runs: Sequence[FleetRun], figures: Sequence[_Figure]) -> dict[str, Any]:
    return {
        "drives": [{"drive": run.drive, "run": str(run.path)} for run in runs],
        "figures": [
            {
                "figure": figure.name,
                "unit": figure.unit,
                "drives": figure.drives,
                "median": figure.median,
                "robust_scatter": figure.scatter,
                "limit_robust_deviations": figure.limit,
                "outliers": [runs[k].drive for k in figure.far()],
            }
            for figure in figures
        ],
    }
