"""Write docs/public-logs.md: records that others measured, from the raw file to a diagnosis.

    python tools/real.py [--work DIR] [--page FILE]

Needs HDBENCH_DATA and the extra `logs`. Every set is imported and diagnosed by the commands that
the page shows; what is published comes from truth.json beside the data. A set whose answer is in
the work folder already is not diagnosed again.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from real_picture import draw
from real_sets import SETS, Log

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tools" / "blind"))

# makes the scorer importable
from real_records import profile_text  # noqa: E402
from scorer.real import judge_real  # noqa: E402

_HEAD = """# Logs of others

What `hdbench` makes of records that others measured and published: the commands from the raw file
on, the torque against the simulation, and what was named beside what is published. `make real`
writes this page; the numbers come from that run. The data are not part of this project: each
section names where they come from.

A profile is made by `hdbench profile new NAME --out NAME.toml`; the keys that were set in it stand
above the commands. In the pictures, simulated is the model of the profile and extended the model
with what was named, both through the low-pass that the torque had passed before it was stored.
"""


def hdbench(words: list[str], folder: Path) -> tuple[int, dict[str, Any]]:
    """Run one command in a folder; return its exit code and its JSON object."""
    command = [sys.executable, "-m", "hdbench_cli", *words, "--json"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return done.returncode, json.loads(done.stdout or "{}")


def answer_of(log: Log, data: Path, folder: Path, keys: Mapping[str, Any]) -> dict[str, Any]:
    """Import and diagnose a log; return the steps with their answers."""
    kept = folder / "answer.json"
    if kept.exists():
        return dict(json.loads(kept.read_text()))
    folder.mkdir(parents=True, exist_ok=True)
    raw = folder / Path(log.file).name
    if not raw.exists():
        raw.symlink_to(data / log.file)
    (folder / f"{log.profile}.toml").write_text(profile_text(keys))
    steps = []
    for command in log.commands:
        code, body = hdbench(shlex.split(command), folder)
        steps.append({"command": command, "exit": code, "body": body})
    answer = {"steps": steps}
    kept.write_text(json.dumps(answer))
    return answer


def _value(entry: Mapping[str, Any]) -> str:
    std = entry.get("std")
    return f"{entry['value']:.4g}" + ("" if std is None else f" ± {std:.2g}")


def _named(body: Mapping[str, Any]) -> Iterator[str]:
    yield "| named | parameters | of the variance |"
    yield "|---|---|---|"
    for cause in [*body["causes"], *body.get("minor", ())]:
        told = ", ".join(
            f"{name} {_value(entry)}"
            for name, entry in (cause["parameters"] or {}).items()
            if not name.startswith(("cosine_", "sine_"))  # amplitude and phase say the same
        )
        share = (cause.get("gain") or {}).get("explained_fraction")
        also = [n for n in cause.get("group", ()) if n != cause["name"]]
        name = cause["name"] + (f" (or {', '.join(also)})" if also else "")
        yield f"| {name} | {told} | {'' if share is None else f'{100 * share:.1f} %'} |"


def _published(known: Mapping[str, Any], body: Mapping[str, Any]) -> Iterator[str]:
    """Return what is published beside what was found."""
    verdict = judge_real(known, {"answer": body, "cpu_s": 0.0, "torque_rms_nm": 1.0})
    rows = [f"| {name} | named | {'named' if hit else '**not named**'} | |"
            for name, hit in verdict.named.items()]  # fmt: skip
    for name, (value, std, close, _) in verdict.parameters.items():
        truth, spread = known["parameters"][name]
        found = "**not found**" if value is None else f"{value:.4g} ± {std:.2g}"
        rows.append(f"| {name} | {truth:.4g} ± {spread:.2g} | {found} | {_mark(close)} |")
    for order, (close, value) in verdict.orders.items():
        truth, spread = {**known.get("orders", {}), **known.get("orders_in_baseline", {})}[order]
        found = "**not found**" if value is None else f"{value:.3g}"
        row = f"| order {order}, amplitude, N m | {truth:.3g} ± {spread:.2g} | {found} |"
        rows.append(f"{row} {_mark(close)} |")
    if rows:
        yield from ("| | published | hdbench | |", "|---|---|---|---|", *rows, "")
    if known.get("must_not"):
        wrong = ", ".join(verdict.forbidden)
        names = ", ".join(known["must_not"])
        yield f"Known not to be there: {names}. " + (
            f"**Named all the same: {wrong}.**" if wrong else "None was named."
        )
        yield ""


def _mark(close: bool) -> str:
    return "agrees" if close else "**differs**"


def _untestable(body: Mapping[str, Any]) -> Iterator[str]:
    """Return what this record cannot show, the names of one reason together."""
    reasons: dict[str, list[str]] = {}
    for entry in body.get("testable", ()):
        if not entry["testable"]:
            reasons.setdefault(entry["because"], []).append(entry["name"])
    if reasons:
        yield "Not testable on this record:"
        yield ""
        yield from (f"* {', '.join(names)}: {because}" for because, names in reasons.items())
        yield ""


def section(log: Log, answer: Mapping[str, Any], known: Mapping[str, Any], picture: str | None,
            keys: Mapping[str, Any]) -> Iterator[str]:  # fmt: skip
    """Return the lines about one log."""
    yield from (f"## {log.title}", "", log.source, "")
    if keys:
        told = ", ".join(f"`{name} = {value}`" for name, value in keys.items())
        yield from (f"`{log.profile}.toml`: {told}.", "")
    yield "```console"
    for step in answer["steps"]:
        yield f"$ hdbench {step['command']}"
        yield from _said(step)
    yield from ("```", "")
    body = answer["steps"][-1]["body"]
    if "causes" in body:
        if picture is not None:
            yield from (f"![Measured against simulated torque: {log.title}]({picture})", "")
        yield from _published(known, body)
        yield from (
            f"Verdict: `{body['verdict']}`, unexplained places: {len(body['unexplained'])}.",
            "",
        )
        yield from (*_named(body), "")
        yield from _untestable(body)
    notes = [*log.notes, *(known[key] for key in ("note", "beyond") if key in known)]
    yield from (line for note in notes for line in (note.rstrip(".") + ".", ""))


def _said(step: Mapping[str, Any]) -> Iterator[str]:
    """Return what the command told, as short as the page can have it."""
    body = step["body"]
    if "error" in body:
        error = body["error"]
        yield f"exit {step['exit']}: {error['what']}"
        yield f"fix: {error['fix']}"
    elif "proposal" in body:
        yield from (f"needed: {need}" for need in body["proposal"]["needs"])
        yield body["proposal"]["command"]
    elif "rows" in body:
        yield f"{body['rows']} rows of {', '.join(body['columns'])}"
    elif step["exit"]:
        yield f"exit {step['exit']}: finished, but the data are doubtful"
    elif "findings" in body:
        yield from (f"{f['name']}: {f['detail']}: {f['consequence']}" for f in body["findings"])


def main() -> int:
    """Run every set and write the page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "real")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "public-logs.md")
    parser.add_argument("names", nargs="*", help="only run these sets, and write no page")
    asked = parser.parse_args()
    place = os.environ.get("HDBENCH_DATA")
    if not place or not (Path(place) / "real" / "truth.json").exists():
        sys.exit("HDBENCH_DATA names no folder with real/truth.json; set it to that of the records")
    if find_spec("rosbags") is None:
        sys.exit("rosbags is not installed; needed for the UR10: pip install -e .[logs]")
    data = Path(place).resolve()
    truth = json.loads((data / "real" / "truth.json").read_text())
    lines = [_HEAD]
    for log in SETS:
        if asked.names and log.name not in asked.names:
            continue
        known = truth.get(log.name, {})
        keys = known.get("profile", {})
        keys = log.keys or (truth[keys]["profile"] if isinstance(keys, str) else keys)
        folder = (asked.work / log.name).resolve()
        answer = answer_of(log, data, folder, keys)
        picture = draw(answer["steps"][-1]["body"], folder, asked.page.parent, log.name)
        lines += section(log, answer, known, picture, keys)
        print(log.name, [step["exit"] for step in answer["steps"]], flush=True)
    if not asked.names:
        asked.page.write_text("\n".join(lines).rstrip() + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
