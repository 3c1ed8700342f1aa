"""Hostile files: profiles, traces, loads and journals, mutated and made up."""

from __future__ import annotations

import random
import resource
import time
from collections.abc import Callable
from pathlib import Path

from faults.kit import Row

__all__ = ["profiles", "traces"]

LONGEST_S, MOST_MIB = 1.0, 200.0
PIECES = (
    "nan", "inf", "-inf", "1e999", "-0", "[", "]", "{", "}", '"', "'''", "\n", "\0", "=", ",", ";",
    "\u202e", "\ud7ff", "\x1b[2J", "[[a]]", "a.b.c.d", "0x", "_", "9" * 400, "1979-05-27", "true",
    "#", "..", "=1", "@SUM", "time_s", "torque_nm",
)  # fmt: skip


def _mutated(text: str, chance: random.Random) -> str:
    for _ in range(chance.randint(1, 8)):
        at = chance.randint(0, len(text))
        match chance.randrange(5):
            case 0:
                text = text[:at] + chance.choice(PIECES) + text[at:]
            case 1:
                text = text[:at] + text[at + chance.randint(1, 40) :]
            case 2:
                lines = text.split("\n")
                lines[chance.randrange(len(lines))] = chance.choice(lines)
                text = "\n".join(lines)
            case 3:
                text = (
                    text[:at] + chr(chance.choice((chance.randrange(128), 0x20AC))) + text[at + 1 :]
                )
            case _:
                low = chance.randint(0, len(text))
                text = text[:at] + text[low : low + 60] + text[at:]
    return text


def _extreme(number: int) -> str | None:
    """Return one of the cases that no mutation finds."""
    cases = (
        "", "\0", "[" * 5000, "a = " + "[" * 3000 + "]" * 3000, "a." * 4000 + "b = 1",
        "x = 1\n" * 20000, "k = '" + "y" * (1 << 20) + "'", "\ufeff[name]",
        '[daq]\naddress = "tcp://' + "a" * 5000 + '"',
    )  # fmt: skip
    return cases[number] if number < len(cases) else None


def _tried(row: Row, attempt: Callable[[], object], what: str) -> None:
    from hdbench.errors import HdbenchError

    start_s = time.monotonic()
    used = resource.getrusage(resource.RUSAGE_SELF)
    problem = ""
    try:
        attempt()
        row.count("accepted")
    except HdbenchError as error:
        row.count(f"exit {error.exit_code}")
        problem = "" if error.what and error.where and error.fix else "an error without a fix"
    except Exception as error:  # noqa: BLE001 - what is looked for: anything but our own errors
        problem = f"{type(error).__name__}: {error} in {what[:120]!r}"
    after = resource.getrusage(resource.RUSAGE_SELF)
    # time of this process, not of what else the machine does
    took_s = after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime
    row.notes["worst cpu s"] = max(float(str(row.notes.get("worst cpu s", 0.0))), round(took_s, 3))
    del start_s
    row.add(problem or (f"{took_s:.2f} s" if took_s > LONGEST_S else ""))


def _memory(row: Row, before_mib: float) -> None:
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0 - before_mib
    row.notes["memory above the start, MiB"] = round(used, 1)
    if used > MOST_MIB:
        row.add(f"{used:.0f} MiB")


def _rss_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def profiles(_folder: Path, trials: int, seed: int) -> Row:
    """Profiles, mutated from every one that comes with hdbench, and extreme ones."""
    from hdbench.profile import parse_profile

    row = Row("25", "hostile profiles")
    chance = random.Random(seed)
    shipped = [
        p.read_text() for p in sorted((Path(__file__).parents[2] / "profiles").glob("*.toml"))
    ]
    before_mib = _rss_mib()
    for number in range(trials):
        text = _extreme(number) or _mutated(chance.choice(shipped), chance)
        _tried(row, lambda text=text: parse_profile(text, "hostile.toml"), text)  # type: ignore[misc]
    _memory(row, before_mib)
    return row


def traces(folder: Path, trials: int, seed: int) -> Row:
    """Traces, loads and journals, mutated."""
    import numpy as np

    from hdbench.profile import load_profile
    from hdbench.records.journal import JournalWriter, read_journal
    from hdbench.records.loads import read_loads
    from hdbench.records.tracefile import read_trace

    row = Row("26", "hostile traces, loads files and journals")
    chance, arm = random.Random(seed), load_profile("cim-tr-97-06").data.arm
    trace = "time_s,torque_nm,motor_velocity_rad_s\n" + "".join(
        f"{n * 0.001!r},{0.1 * n!r},{156.0 + n!r}\n" for n in range(60)
    )
    loads = "experiment,position_rad,range,direction,series,torque_nm,reading_v\n" + "".join(
        f"a,0.0,low,cw,up,{float(n)!r},{0.15 * n!r}\n" for n in range(12)
    )
    journal, path = folder / "hostile.hdj", folder / "hostile.csv"
    with JournalWriter(journal) as writer:
        for n in range(20):
            writer.append("samples", {"time_s": np.arange(5.0) + 5 * n, "torque_v": np.ones(5)})
    raw = journal.read_bytes()
    before_mib = _rss_mib()
    for number in range(trials):
        kind = number % 3
        if kind == 2:
            changed = bytearray(raw)
            for _ in range(chance.randint(1, 12)):
                changed[chance.randrange(len(changed))] = chance.randrange(256)
            path.write_bytes(changed[: chance.randint(0, len(changed))])
            _tried(row, lambda: read_journal(path), "journal")
            continue
        text = _extreme(number) or _mutated(loads if kind else trace, chance)
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        read = (lambda: read_loads(path, arm)) if kind else (lambda: read_trace(path))
        _tried(row, read, text)
    _memory(row, before_mib)
    return row
