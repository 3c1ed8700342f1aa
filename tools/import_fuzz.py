"""Mutated logs of every format: each is imported, or refused in one line and without a trace of it.

usage: python tools/import_fuzz.py [--files 2000] [--seed 1] [FORMAT...]

A format runs in a process of its own, so that a crash is seen; the time of each file is bounded.
Libraries read in a child of it: their crashes are refusals and are counted. The memory is of both.
Prints one row a format; ends 1 where anything was wrong.
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

from import_samples import MAPS, SAMPLES, have, write_sample

MOST_MIB, LONGEST_S = 500.0, 20.0
GOOD = ("imported", "refused", "crashed")
_JOINT_FORMS = ("db3", "mcap", "ros1")


def mutated(raw: bytes, chance: random.Random) -> bytes:
    """Return the bytes of a file with some of them changed, moved, doubled or cut off."""
    data = bytearray(raw)
    for _ in range(chance.randint(1, 6)):
        if not data:
            break
        at = chance.randrange(len(data))
        match chance.randrange(7):
            case 0:
                data[at] ^= 1 << chance.randrange(8)
            case 1:
                data[at : at + 4] = chance.randbytes(4)
            case 2:
                del data[at:]
            case 3:
                size = chance.choice((1, 2, 4, 8))
                data[at : at + size] = b"\xff" * size
            case 4:
                del data[at : at + chance.randint(1, 64)]
            case 5:
                data[at:at] = data[at : at + chance.randint(1, 64)]
            case _:
                to = chance.randrange(len(data))
                data[at : at + 16] = data[to : to + 16]
    return bytes(data)


def _import(form: str, file: Path, out: Path) -> str:
    """Import one file as the command does; return how it ended."""
    from hdbench.errors import HdbenchError
    from hdbench.importing.importer import import_files
    from hdbench.importing.listing import list_channels
    from hdbench.importing.recipe import Recipe
    from hdbench.importing.registry import open_source

    joint = "elbow" if form in _JOINT_FORMS else None
    maps = dict(text.split("=", 1) for text in MAPS[form])
    recipe = Recipe(map=maps, joint=joint)
    try:
        source = open_source(file, recipe)
        try:
            list_channels(source)
        finally:
            source.close()
        import_files(recipe, [file], out, gear_ratio=100.0)
    except HdbenchError as error:
        if error.exit_code not in (2, 4):
            return f"exit {error.exit_code}: {error.what}"
        if "\n" in error.what or not (error.what and error.where and error.fix):
            return f"no clear line: {error.what!r}"
        return "crashed" if "its reader crashed" in error.what else "refused"
    return "imported"


def _most_mib() -> float:
    """Return the most memory that this process and its largest child had, MiB."""
    # the usage of a process begins with that of the one which started it; its own peak does not
    status = Path("/proc/self/status").read_text()
    own = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return (int(own.split()[1]) + children) / 1024.0


def _alarm(*_: object) -> None:
    raise TimeoutError


def _campaign(form: str, files: int, seed: int, kept: str, results: Any) -> None:
    from hdbench.importing.registry import end_reader

    warnings.simplefilter("ignore")
    chance = random.Random(f"{form} {seed}")
    signal.signal(signal.SIGALRM, _alarm)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sample = write_sample(form, folder)
        raw = sample.read_bytes()
        out = folder / "out.csv"
        assert _import(form, sample, out) == "imported", form  # noqa: S101 - or all would be void
        for path in (out, out.with_name("out.csv.provenance.json")):
            path.unlink()
        for number in range(files):
            sample.write_bytes(mutated(raw, chance))
            results.put(("begun", number, ""))
            begun = time.monotonic()
            signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
            try:
                end = _import(form, sample, out)
            except TimeoutError:
                end = f"longer than {LONGEST_S:g} s"
            except BaseException as error:  # noqa: BLE001 - this is what is looked for
                end = f"{type(error).__name__}: {error}"[:200]
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0)
            left = sorted(p.name for p in folder.iterdir() if p.name not in (sample.name,))
            if end == "imported":
                out.unlink()
                out.with_name("out.csv.provenance.json").unlink()
            elif left:
                end = f"left behind {left[:3]}"
            if end not in GOOD:
                Path(kept, f"{form}-{seed}-{number}{sample.suffix}").write_bytes(
                    sample.read_bytes()
                )
            results.put((end, number, time.monotonic() - begun))
        end_reader()
        results.put(("memory", _most_mib(), 0.0))


def run(form: str, files: int, seed: int, kept: Path) -> tuple[Counter[str], float, float]:
    """Return how the files of one format ended, the memory, MiB, and the longest time, s."""
    context = multiprocessing.get_context("spawn")
    results: Any = context.Queue()
    kept.mkdir(parents=True, exist_ok=True)
    process = context.Process(target=_campaign, args=(form, files, seed, str(kept), results))
    process.start()
    ends: Counter[str] = Counter()
    memory, longest, last = 0.0, 0.0, -1
    while True:
        try:
            end, number, more = results.get(timeout=1.0)
        except Exception:  # noqa: BLE001 - the queue is empty: is the process still there?
            if process.is_alive():
                continue
            break
        if end == "begun":
            last = number
        elif end == "memory":
            memory = number
            break
        else:
            ends[end] += 1
            longest = max(longest, more)
    process.join()
    if process.exitcode:
        ends[f"the process ended with {process.exitcode} at file {last}"] += 1
    return ends, memory, longest


def main() -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--files", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kept", type=Path, default=Path("build/fuzz"))
    parser.add_argument("forms", nargs="*", metavar="FORMAT")
    asked = parser.parse_args()
    bad = False
    for form in asked.forms or SAMPLES:
        libraries = SAMPLES[form][1]
        if not have(*libraries):
            print(f"{form:<8} not run: needs {', '.join(libraries)}")
            continue
        ends, memory, longest = run(form, asked.files, asked.seed, asked.kept)
        good = {key: ends.pop(key, 0) for key in GOOD}
        wrong = sum(ends.values()) > 0 or memory > MOST_MIB
        bad |= wrong
        print(
            f"{form:<8} {good['imported']:5d} imported {good['refused']:5d} refused "
            f"{good['crashed']:3d} crashed the library {sum(ends.values()):4d} wrong "
            f"{memory:6.0f} MiB {longest:6.2f} s longest",
            flush=True,
        )
        for end, count in ends.most_common(8):
            print(f"         {count:4d} x {end}", flush=True)
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
