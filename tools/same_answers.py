"""Comparison of the answers of two versions: a fixed set of commands, recorded and compared.

    PYTHONPATH=CHECKOUT python tools/same_answers.py record --python PYTHON OUT
    python tools/same_answers.py compare BEFORE AFTER

`record` runs the commands of same_answers.txt with the hdbench that PYTHON imports, each in a
folder of its own, and keeps exit codes, JSON output and the JSON and CSV files that were written.
`compare` prints what differs and exits 1 on a difference; those that same_answers.txt gives a
reason for are counted apart. `--only calibrate,filter` takes sections
of the set (and what they need); `--inputs OUT` takes the input files of an earlier recording.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import json
import math
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
SET = Path(__file__).with_suffix(".txt")
PATIENCE_S = 900.0
PLACEHOLDER = re.compile(r"\{([\w-]+)\}")
NUMBERS = re.compile(r": (-?\d[\d.e+-]*) -> (-?\d[\d.e+-]*)$")
HIDDEN = (
    "ripple-harmonic", "motor-unbalance", "structural-tone", "coulomb-friction", "hysteresis",
    "zero-step", "position-dependent-gain",
)  # fmt: skip

# keys whose values may differ: versions, moments and ages, names of runs and machines; a report
# puts what they belong to before them, as in "device: firmware"
FREE_KEYS = re.compile(
    r"(.*: )?(.*_)?(utc|version|versions|hash|host|hostname|computer|user|pid|process_mark|command"
    r"|seconds|age_days|age_words|firmware|hdbench|python|numpy|system)"
)
# what is left of texts when identifiers, folders, hashes and moments are taken out
TEXTS = (
    (re.compile(r"\d{8}T\d{6}Z-([a-z]+)-[0-9a-f]{6}"), r"<run of \1>"),
    (re.compile(r"(/[\w.-]+)*/hdbench-answers-\w+"), "<folder>"),
    (re.compile(r"(/[\w.-]+)*/(hdbench_)?profiles/"), "<profiles>/"),
    (re.compile(r"\b[0-9a-f]{64}\b"), "<hash>"),
    (re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|\+00:00| UTC)?"), "<moment>"),
    (re.compile(r"hdbench \d+\.\d+\S*"), "hdbench <version>"),
)


def fixed_set() -> dict[str, tuple[str, list[str]]]:
    """Return section and words of each command, by its name, in the order of the file."""
    section, out = "", {}
    for line in SET.read_text().splitlines():
        if line.startswith("["):
            section = line.strip("[]")
        elif line and line[0] not in "#~":
            name, _, words = line.partition(": ")
            out[name] = (section, words.split())
    return out


def intended() -> list[tuple[str, float, str]]:
    """Return patterns of differences on purpose, how large they may be, and why they are."""
    out = []
    for line in SET.read_text().splitlines():
        if line.startswith("~"):
            told, _, reason = line[2:].rpartition(" = ")
            pattern, _, most = told.partition(" within ")
            out.append((pattern, float(most or "inf"), reason))
    return out


def chosen(only: list[str]) -> list[str]:
    """Return the commands of some sections and those whose results they take, in order."""
    commands = fixed_set()
    sections = {section for section, _ in commands.values()}
    if unknown := set(only) - sections:
        raise SystemExit(f"no section {sorted(unknown)} in {SET.name}: {sorted(sections)}")
    todo = [name for name, (section, _) in commands.items() if not only or section in only]
    order: list[str] = []

    def add(name: str) -> None:
        for other in PLACEHOLDER.findall(" ".join(commands[name][1])):
            if other != "in":
                add(other)
        if name not in order:
            order.append(name)

    for name in todo:
        add(name)
    return order


def write_inputs(folder: Path) -> None:
    """Write what the commands read: injected records, logs, broken files, the stored cases."""
    shutil.copytree(ROOT / "tests" / "stored", folder / "stored", ignore=_no_code)
    shutil.copytree(folder / "stored" / "calibration", folder / "moved" / "calibration")
    expected = folder / "moved" / "calibration" / "expected.json"
    moved = json.loads(expected.read_text())
    moved["result"]["consistency"] *= 1.001
    expected.write_text(json.dumps(moved))
    _write_injected(folder)
    _write_logs(folder)
    _write_broken(folder)


def _no_code(_: str, names: list[str]) -> list[str]:
    return [name for name in names if name.endswith(".py") or name == "__pycache__"]


def _write_table(path: Path, columns: dict[str, Any]) -> None:
    rows = [
        ",".join(columns),
        *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True)),
    ]
    path.write_text("\n".join(rows) + "\n")


def _write_injected(folder: Path) -> None:
    sys.path.insert(0, str(ROOT / "tests" / "blind"))
    from injector.build import Case, Hidden
    from injector.cases import make

    cases = {f"clean-{k}": Case(f"same-{k}", "A", "compact", seed=6000 + k) for k in range(2)}
    for k, name in enumerate(HIDDEN):
        hidden = (Hidden(name, "d20"),)
        cases[name] = Case(f"same-{name}", "B", "compact", "ar", seed=6100 + k, hidden=hidden)
    for k, name in enumerate(("", "cubic-nonlinearity", "hysteresis")):
        hidden = (Hidden(name, "d20"),) if name else ()
        key = f"loads-{name or 'clean'}"
        cases[key] = Case(key, "L", "loads", sigma_nm=0.005, seed=6200 + k, hidden=hidden)
    for name, case in cases.items():
        columns = make(case).columns
        if case.part == "L":
            rows = columns["readings"]
            columns = {key: [row[key] for row in rows] for key in rows[0]}
        else:
            columns = {key: np.asarray(values).tolist() for key, values in columns.items()}
        _write_table(folder / f"{name}.csv", columns)


def _write_logs(folder: Path) -> None:
    """Write a stored trace as loggers and programs of others do."""
    with gzip.open(folder / "stored" / "ripple" / "trace.csv.gz", "rt") as file:
        names = file.readline().strip().split(",")
        data = np.loadtxt(file, delimiter=",", max_rows=8000)
    at, tacho, volts = (data[:, names.index(name)] for name in ("time_s", "tacho_v", "torque_v"))
    speed, torque = 20.0 * tacho, 6.6 * volts
    log = {"Timestamp": at, "speed": speed, "torque": torque, "t_ms": 1000.0 * at,
           "rpm": speed * 30.0 / math.pi, "Torque": torque}  # fmt: skip
    _write_table(folder / "log.csv", {key: values.tolist() for key, values in log.items()})
    angle = np.cumsum(speed) * float(np.median(np.diff(at)))
    np.savez(folder / "robot.npz", t=at, q_2=angle / 100, qd_2=speed / 100, tau_2=torque)
    cells = [[f"{x:.6f}" for x in row] for row in zip(at, volts, tacho, strict=True)]
    stream = ["11/21/2026", "10:15:00 AM", "Time\tv0\tv1", *map("\t".join, cells)]
    (folder / "stream_0.dat").write_text("\n".join(stream) + "\n")
    export = ['"Relative Time","Torque","Tacho"', '"sec","Volt","Volt"', *map(",".join, cells)]
    (folder / "windaq.csv").write_text("\n".join(export) + "\n")
    spread = random.Random(1)
    levels = [level for level in (0, 1, 2, 1, 0) for _ in range(80)]
    readings = [f"{0.1 * level + spread.gauss(0.0, 0.002):.5f}" for level in levels]
    times = [100 * k for k in range(len(levels))]
    _write_table(folder / "weights.csv", {"t_ms": times, "counts": readings})


def _write_broken(folder: Path) -> None:
    lines = (folder / "clean-0.csv").read_text().splitlines()
    head, rows = lines[0], lines[1:4001]
    loads = (folder / "stored" / "calibration" / "loads.csv").read_text()
    first = rows[100].split(",")
    broken = {
        "cell.csv": [head, *rows[:100], ",".join(["x1", *first[1:]]), *rows[101:]],
        "time.csv": [head, *rows[:100], rows[50], *rows[101:]],
        "gap.csv": [head, *rows[:1000], *rows[1800:]],
        "column.csv": [head.replace("torque_", "moment_"), *rows],
        "empty.csv": [head],
        "loads.csv": [loads.replace("ccw", "left", 3)],
        "profile.toml": ['[identity]\nname = "x"\n[drive]\ngear_ratio = -100\nratio = 1\n'],
        "model.json": ['{"schema": "hdbench/filter-model/1", "orders": [2, 4'],
    }
    for name, content in broken.items():
        (folder / f"broken-{name}").write_text("\n".join(content) + "\n")
    (folder / "broken-bytes.csv").write_bytes(b"\x00\xff\xfe" + bytes(range(256)) * 8)
    (folder / "broken-run").mkdir()
    (folder / "broken-run" / "run.json").write_text('{"kind": "ripple", "status": "done"')


def record(python: str, out: Path, only: list[str], inputs: Path | None) -> None:
    """Run the commands in a fresh folder and keep what they answer in `out`."""
    if out.exists():
        raise SystemExit(f"{out} is there already; name a new folder")
    commands, environment = fixed_set(), {**os.environ, "NO_COLOR": "1", "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory(prefix="hdbench-answers-") as name:
        root = Path(name)
        if inputs is None:
            (root / "in").mkdir()
            write_inputs(root / "in")
        else:
            shutil.copytree(inputs / "in", root / "in")
        for command in chosen(only):
            folder = root / command
            folder.mkdir()
            words = [PLACEHOLDER.sub(lambda m: _place(root, m[1]), w) for w in commands[command][1]]
            done = subprocess.run(
                [python, "-m", "hdbench_cli", *words, "--json"],
                cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True,
                text=True, timeout=PATIENCE_S, check=False,
            )  # fmt: skip
            (folder / "exit-code.json").write_text(f"{done.returncode}\n")
            (folder / "stdout.json").write_text(done.stdout)
            print(f"{command}: {done.returncode}", flush=True)
            if done.returncode == 1:
                print(done.stderr, flush=True)
        shutil.copytree(root, out, ignore=_no_others)


def _place(root: Path, name: str) -> str:
    runs = sorted((root / name).glob("runs/*/run.json"))
    return os.path.join("..", *(runs[0].parent if runs else root / name).relative_to(root).parts)


def _no_others(folder: str, names: list[str]) -> list[str]:
    if Path(folder).name == "in" or "in" in Path(folder).parts:
        return []
    kept = (".json", ".csv", ".csv.gz")
    return [n for n in names if not n.endswith(kept) and not (Path(folder) / n).is_dir()]


def _plain(text: str) -> str:
    for pattern, instead in TEXTS:
        text = pattern.sub(instead, text)
    return text


def _differences(before: Any, after: Any, key: str, beyond: float) -> Iterator[str]:
    """Yield the keys at which two JSON values differ in what must not change."""
    if isinstance(before, float) and isinstance(after, float):
        if abs(before - after) > beyond * max(abs(before), abs(after)):
            yield f"{key}: {before} -> {after}"
        return
    if isinstance(before, dict) and isinstance(after, dict):
        # names of files may hold those of runs
        first, second = ({_plain(k): v for k, v in d.items()} for d in (before, after))
        for name in first.keys() | second.keys():
            if name not in second or name not in first:
                yield f"{key}.{name}: only {'before' if name in first else 'after'}"
            elif not FREE_KEYS.fullmatch(name):
                yield from _differences(first[name], second[name], f"{key}.{name}", beyond)
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for place, (one, two) in enumerate(zip(before, after, strict=True)):
            yield from _differences(one, two, f"{key}[{place}]", beyond)
    elif isinstance(before, str) and isinstance(after, str):
        if _plain(before) != _plain(after):
            yield f"{key}: {before[:200]!r} -> {after[:200]!r}"
    elif type(before) is not type(after) or before != after:
        yield f"{key}: {str(before)[:100]} -> {str(after)[:100]}"


def _text(path: Path) -> str:
    content = path.read_bytes()
    return (gzip.decompress(content) if path.suffix == ".gz" else content).decode()


def _rows(text: str) -> list[str]:
    """Return the lines of a table without the columns that may differ."""
    lines = _plain(text).splitlines()
    names = lines[0].split(",") if lines else []
    if not any(FREE_KEYS.fullmatch(name) for name in names):
        return lines
    rows = csv.reader(lines)
    return [
        ",".join(
            cell for name, cell in zip(names, row, strict=False) if not FREE_KEYS.fullmatch(name)
        )
        for row in rows
    ]


def _file_differences(before: Path, after: Path, beyond: float) -> Iterator[str]:
    one, two = _text(before), _text(after)
    if before.suffix == ".json":
        try:
            yield from sorted(_differences(json.loads(one), json.loads(two), "", beyond))
            return
        except ValueError:
            pass  # not JSON: a help text or nothing
    first, second = _rows(one), _rows(two)
    if len(first) != len(second):
        yield f"{len(first)} -> {len(second)} lines"
    for line, (old, new) in enumerate(zip(first, second, strict=False), 1):
        if old != new:
            yield f"line {line}: {old[:120]!r} -> {new[:120]!r}"
            return


def _reason(difference: str) -> str:
    """Return why a difference is on purpose; empty where it is not."""
    numbers = NUMBERS.search(difference)
    size = abs(float(numbers[2]) - float(numbers[1])) if numbers else math.inf
    return next(
        (why for what, most, why in intended() if size <= most and fnmatchcase(difference, what)),
        "",
    )


def compare(before: Path, after: Path, beyond: float) -> int:
    """Print what differs between two recordings; return how many files do."""
    commands = [name for name in fixed_set() if (after / name).is_dir()]
    commands = [name for name in commands if (before / name).is_dir()]
    if not commands:
        raise SystemExit(f"{before} and {after} have no command in common")
    bad = files = 0
    reasons: Counter[str] = Counter()
    for name in commands:
        both = [
            {_plain(str(p.relative_to(top / name))): p for p in sorted((top / name).rglob("*.*"))
             if p.is_file()}
            for top in (before, after)
        ]  # fmt: skip
        for file in sorted(both[0].keys() | both[1].keys()):
            files += 1
            if file not in both[0] or file not in both[1]:
                told = [f"only {'before' if file in both[0] else 'after'}"]
            else:
                told = list(_file_differences(both[0][file], both[1][file], beyond))
            why = {line: _reason(f"{name}/{file}: {line}") for line in told}
            reasons.update(filter(None, why.values()))
            told = [line for line in told if not why[line]]
            if told:
                bad += 1
                print(f"{name}/{file}:", *told[:20], sep="\n    ")
                if len(told) > 20:
                    print(f"    and {len(told) - 20} more")
    for reason, count in reasons.items():
        print(f"on purpose, {reason}: {count}")
    print(f"{len(commands)} commands, {files} files: {bad} differ")
    return bad


def main() -> int:
    """Record or compare; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    actions = parser.add_subparsers(dest="action", required=True)
    recording = actions.add_parser("record", help="run the set and keep its answers")
    recording.add_argument("--python", default=sys.executable)
    recording.add_argument("--only", default="", help="sections of the set, with commas")
    recording.add_argument("--inputs", type=Path, help="recording whose input files are taken")
    recording.add_argument("out", type=Path)
    comparing = actions.add_parser("compare", help="say what differs between two recordings")
    comparing.add_argument(
        "--beyond", type=float, default=0.0, help="pass over smaller relative differences in JSON"
    )
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    told = parser.parse_args()
    if told.action == "compare":
        return 1 if compare(told.before, told.after, told.beyond) else 0
    only = [word for word in told.only.split(",") if word]
    record(told.python, told.out.absolute(), only, told.inputs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
