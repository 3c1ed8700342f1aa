import base64
import csv
import hashlib
import json
import re
import shutil
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import bench_runs as bench
import generate
import pytest

from hdbench.errors import DataError, UsageError
from hdbench.report import ReportFiles, write_report

UNSEEN = ("style", "script", "metadata")


class Page(HTMLParser):
    """Collects what a browser would see."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self._hidden = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._hidden += tag in UNSEEN

    def handle_endtag(self, tag: str) -> None:
        self._hidden -= tag in UNSEEN

    def handle_data(self, data: str) -> None:
        if not self._hidden:
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def page(report: ReportFiles) -> Page:
    return Page(report.html.read_text(encoding="utf-8"))


def test_the_page_needs_nothing_from_outside(page, report):
    assert not [tag for tag, _ in page.tags if tag in ("link", "iframe", "object", "img")]
    for _, attributes in page.tags:
        for name in ("src", "href", "xlink:href", "action", "data"):
            assert not re.match(r"[a-z]+:|//", attributes.get(name) or "", re.IGNORECASE)
        assert not any(name.startswith("on") for name in attributes)
    text = report.html.read_text(encoding="utf-8")
    assert "@import" not in text
    assert not re.search(r"url\((?!#)", text)


def test_the_page_carries_a_policy_that_lets_its_one_script_run_and_no_other(page, report):
    policy = next(a["content"] for tag, a in page.tags if a.get("http-equiv"))
    assert "default-src 'none'" in policy
    scripts = re.findall(r"<script>(.*?)</script>", report.html.read_text("utf-8"), re.DOTALL)
    assert len(scripts) == 1
    digest = base64.b64encode(hashlib.sha256(scripts[0].encode()).digest()).decode()
    assert re.findall(r"script-src ([^;]*)", policy) == [f"'sha256-{digest}'"]
    assert not {"innerHTML", "eval(", "fetch(", "XMLHttpRequest"} & set(
        re.findall(r"\w+\(?", scripts[0])
    )


def test_every_figure_has_an_alternative_text_and_a_caption(page):
    figures = [a for tag, a in page.tags if tag == "svg"]
    assert len(figures) == sum(tag == "figcaption" for tag, _ in page.tags)
    assert all(a["role"] == "img" and len(a["aria-label"] or "") > 40 for a in figures)


def test_ids_are_unique_and_every_reference_has_its_target(page, report):
    ids = [a["id"] for _, a in page.tags if "id" in a]
    assert len(ids) == len(set(ids))
    still = re.sub(r"<script>.*?</script>", "", report.html.read_text(), flags=re.DOTALL)
    used = re.findall(r"url\(#([^)]*)\)|href=\"#([^\"]*)\"", still)
    assert {a or b for a, b in used} <= set(ids)


def test_colours_come_from_the_style_sheet_alone(report):
    text = report.html.read_text()
    style = text[text.index("<style>") : text.index("</style>")]
    figures = "".join(re.findall(r"<svg.*?</svg>", text, re.DOTALL))
    used = set(re.findall(r"var\(--([a-z]+)\)", figures))
    assert used
    assert not re.findall(r"(?:fill|stroke|color): *#[0-9a-f]{3,6}", figures)
    for theme in (style.split("@media")[0], style.split("prefers-color-scheme: dark")[1]):
        assert used - {"sans"} <= set(re.findall(r"--([a-z]+):", theme))


def test_the_page_has_verdict_numbers_figures_filter_and_origin_in_this_order(page):
    text = page.text
    words = (
        "1 worth a look",
        "Calibration accepted",
        "95 % interval",
        *(f"(after figure {number})" for number in (6, 7, 10, 11, 8, 9)),
        "Filter used: report-6",
        "Where the filter's numbers came from",
        "calibration 20260101T000000Z-calibration-abc123",
        "Residual before and after",
        "Residual over motor order",
        "Residual over frequency",
    )
    assert all(word in text for word in words)
    places = [text.index(word) for word in words[:4]]
    assert places == sorted(places)
    assert text.index("Provenance") > places[-1]


def test_key_numbers_in_the_csv_are_those_of_the_results(report, runs):
    lines = report.csv.read_text(encoding="utf-8").splitlines()
    rows = {row["quantity"]: row for row in csv.DictReader(lines)}
    gain = json.loads((runs["calibration"] / "result.json").read_text())["gain_nm_per_v"]
    row = rows["calibration.gain_nm_per_v"]
    # repr of a double reads back exactly
    assert float(row["value"]) == gain["value"]
    assert float(row["std"]) == gain["std"]
    assert float(row["dof"]) == gain["dof"]
    assert row["unit"] == "N m/V"
    assert runs["calibration"].name in row["source"]
    ripple = json.loads((runs["ripple"] / "result.json").read_text())["ripple"][1]
    got = float(rows["ripple.ripple[order=4].amplitude_nm"]["value"])
    assert got == ripple["amplitude_nm"]["value"]


def test_the_json_names_every_run_with_its_verdict(report, runs):
    body = json.loads(report.json.read_text())
    assert body["schema"] == "hdbench/report/1"
    assert [run["run_id"] for run in body["runs"]] == [run.name for run in runs.values()]
    assert [run["verdict"]["level"] for run in body["runs"]] == ["good", "good", "good", "look"]


@pytest.mark.parametrize("kind", ["misalignment", "diagnosis"])
def test_a_run_alone_has_its_sections_only(kind, runs, tmp_path):
    files = write_report([runs[kind]], tmp_path)
    text = Page(files.html.read_text(encoding="utf-8")).text
    assert files.html.name == "report.html"
    assert "(after figure 6)" not in text
    assert "(after figure 8)" not in text
    assert ("(after figure 10)" in text) == (kind == "misalignment")
    assert ("Residual before and after" in text) == (kind == "diagnosis")


def test_links_lead_to_the_raw_files(page, report):
    links = [a["href"] or "" for tag, a in page.tags if tag == "a" and "href" in a]
    raw = [link for link in links if link.endswith(("trace.csv", "loads.csv", "run.json"))]
    assert len(raw) == 3 + 4
    assert all((report.html.parent / link).is_file() for link in raw)


def written(sources: Sequence[Path], folder: Path, **more: Any) -> Page:
    files = write_report(sources, folder / "r.html", **more)
    return Page(files.html.read_text(encoding="utf-8"))


def _copy(run: Path, tmp_path: Path) -> Path:
    return shutil.copytree(run, tmp_path / run.name)


def _edit(file: Path, **changes: object) -> None:
    file.write_text(json.dumps({**json.loads(file.read_text()), **changes}))


def test_a_run_without_a_result_still_shows_its_data(runs, tmp_path):
    run = _copy(runs["ripple"], tmp_path)
    (run / "result.json").unlink()
    _edit(run / "run.json", status="aborted", files={})
    text = written([run], tmp_path).text
    assert "No verdict" in text
    assert "The run was aborted" in text
    assert "(after figure 8)" in text


def test_an_incomplete_run_says_so_on_top_and_text_from_files_is_escaped(runs, tmp_path):
    run = _copy(runs["ripple"], tmp_path)
    evil = "<script>alert(1)</script><img src=x onerror=alert(2)>\"'&$x$"
    _edit(run / "run.json", status="incomplete", exit_reason=evil, device={"model": evil})
    _edit(run / "result.json", flags=[{"name": evil, "samples": 1, "detail": evil}])
    (run / "<b>&quot;.csv").write_text("a\n1\n")
    text = write_report([run], tmp_path / "r.html").html.read_text(encoding="utf-8")
    page = Page(text)
    names = [tag for tag, _ in page.tags]
    assert names.count("script") == 1, "the page's own"
    assert "img" not in names
    assert "b" not in {t for t, a in page.tags if "csv" in str(a)}
    told = page.text
    assert told.index("The run is incomplete") < told.index(evil) < told.index("Key numbers")
    body = json.loads((tmp_path / "r.json").read_text())
    assert body["runs"][0]["verdict"]["level"] == "look"


def test_a_changed_file_is_told_and_ids_of_experiments_do_not_become_markup_or_formulas(
    runs, tmp_path
):
    run = _copy(runs["calibration"], tmp_path)
    for file in (run / "loads.csv", run / "result.json"):
        file.write_text(file.read_text().replace("p0-cw-low", "<i>$x^{$</i>"))
    text = write_report([run], tmp_path / "r.html").html.read_text(encoding="utf-8")
    assert "i" not in {tag for tag, _ in Page(text).tags}
    assert "&lt;i&gt;$x^{$&lt;/i&gt;" in text
    assert "loads.csv was changed after the run" in text


def test_files_alone_are_drawn_and_a_minute_at_one_kilohertz_stays_below_five_megabytes(
    runs, profile, tmp_path
):
    velocity = generate.ramps((0.0, 1.0, 59.0, 60.0), (0, 156, 156, 0))
    trace = bench.trace_of(generate.trace_csv(velocity, 5), tmp_path)
    assert len(trace) == 60_000
    sources = [tmp_path / "raw.csv", runs["calibration"] / "loads.csv"]
    text = written(sources, tmp_path, profile=profile).text
    assert (tmp_path / "r.html").stat().st_size < 5_000_000
    assert "(after figure 8)" in text
    assert "(after figure 7)" in text


def test_a_result_file_alone_gives_numbers_without_figures(runs, tmp_path):
    file = runs["misalignment"] / "result.json"
    page = written([file], tmp_path)
    assert "misalignment, peak to peak" in page.text
    assert not [tag for tag, _ in page.tags if tag == "svg"]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("result.json", "{"),
        ("result.json", '{"schema": "hdbench/ripple/1", "ripple": [{"order": "x"}]}'),
        ("result.json", '{"schema": "hdbench/other/1"}'),
        ("trace.csv", "time_s,tacho_v,torque_v\n0,1,2\n0,1\n"),
    ],
)
def test_a_damaged_run_is_named_and_exits_4(name, text, runs, tmp_path):
    run = _copy(runs["ripple"], tmp_path)
    (run / name).write_text(text)
    with pytest.raises(DataError) as found:
        write_report([run], tmp_path / "r.html")
    assert name in found.value.where
    assert not (tmp_path / "r.html").exists()


def test_no_run_and_no_such_run_are_refused(tmp_path):
    with pytest.raises(UsageError):
        write_report([], tmp_path)
    with pytest.raises(DataError, match="no such"):
        write_report([tmp_path / "nothing"], tmp_path)
    with pytest.raises(DataError, match=r"run\.json"):
        write_report([tmp_path], tmp_path)


def test_a_run_that_ended_before_its_first_sample_still_has_a_report(profile, tmp_path):
    run = bench.new_run(tmp_path / "runs", "ripple", profile)
    run.journal.write_bytes(b"")
    run.finish("incomplete", "stopped by SIGTERM", [])
    text = written([run.path], tmp_path).text
    assert "stopped by SIGTERM" in text
    assert "No verdict" in text
    assert "No data could be recovered" in text


def test_lost_samples_do_not_stop_the_report_and_lines_beyond_the_known_orders_are_told(
    runs, tmp_path
):
    run = _copy(runs["ripple"], tmp_path)
    rows = (run / "trace.csv").read_text().splitlines()
    for row in range(4000, 4007):
        rows[row] = rows[row].partition(",")[0] + "," * rows[row].count(",")
    (run / "trace.csv").write_text("\n".join(rows) + "\n")
    flag = {"name": "missing-samples", "samples": 7, "detail": "7 samples without a torque"}
    amplitude = {"value": 0.2, "std": 0.003, "dof": 5.0}
    sizes = {"amplitude_nm": amplitude, "phase_rad": amplitude}
    line = {"order": 3.0, "false_alarm_probability": 0.0, **sizes}
    tone = {"frequency_hz": 50.0, "false_alarm_probability": 1e-9, **sizes}
    _edit(run / "result.json", flags=[flag], lines=[line], tones=[tone])
    text = written([run], tmp_path).text
    assert "7 samples without a torque" in text
    assert "(after figure 8)" in text
    assert "(after figure 11)" in text
    assert "below 1e-9" in text
    body = json.loads((tmp_path / "r.json").read_text())["runs"][0]
    assert body["verdict"]["level"] == "look"
    assert "motor order 3" in body["verdict"]["text"]
    assert "50 Hz" in body["verdict"]["text"]


def test_a_short_trace_at_rest_says_that_nothing_turns(profile, tmp_path):
    file = tmp_path / "rest.csv"
    rows = [f"{k * 0.001:.3f},0.0,0.0" for k in range(20)]
    file.write_text("\n".join(["time_s,tacho_v,torque_v", *rows]) + "\n")
    assert "Nothing turns steadily" in written([file], tmp_path, profile=profile).text


def test_the_command_writes_into_the_run_or_where_it_is_told(runs, tmp_path, hdbench):
    run = _copy(runs["misalignment"], tmp_path)
    words = ("report", run, "--profile", "cim-tr-97-06")
    assert json.loads(hdbench(*words, "--json")[0])["html"] == str(run / "report.html")
    assert (run / "report.html").is_file()
    hdbench("report", run / "result.json", "--out", tmp_path / "all.html")
    assert (tmp_path / "all.html").is_file()
