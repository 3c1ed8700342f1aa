"""Faults of the wire and of the samples: wrong, late, lost, cut, in pieces; gaps."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np

from faults import replies
from faults.kit import Row
from faults.mangler import FaultKind

__all__ = [
    "cuts",
    "disorder",
    "gaps",
    "noise",
    "pieces",
    "slow_replies",
    "wrong_headers",
    "wrong_replies",
]

DEADLINE_S = {"tcp": 0.1, "rtu": 0.4}
WORST = "worst call over its deadline"


def _wires(
    row: Row,
    kinds: tuple[FaultKind, ...],
    trials: int,
    seed: int,
    wires: tuple[str, ...] = ("tcp", "rtu"),
) -> Row:
    """Make faults of every kind on every wire; each sample is compared with the node's own."""
    each = max(3, trials // (len(kinds) * len(wires)))
    worst, delivered = 0.0, 0
    for wire in wires:
        for kind in kinds:
            faults, _, came, wrong, lost, failed, over, held_up, longest = replies.part(
                wire, kind, each, DEADLINE_S[wire], seed
            )
            delivered, worst = delivered + came, max(worst, longest)
            _more(row, "calls that failed", failed)
            _more(row, "calls over 1.1 deadlines", over)
            _more(row, "for want of a processor", held_up)
            row.trials, row.good = row.trials + faults, row.good + faults - wrong - lost
            row.lost = (row.lost or 0) + lost
            if wrong or lost:
                row.bad.append(f"{wire} {kind}: {wrong} wrong, {lost} lost")
    _more(row, "samples", delivered)
    before = float(str(row.notes.get(WORST, 0.0)))
    row.notes[WORST] = round(max(worst, before), 3)
    return row


def _more(row: Row, what: str, number: int) -> None:
    row.notes[what] = int(str(row.notes.get(what, 0))) + number


def wrong_headers(_folder: Path, trials: int, seed: int) -> Row:
    """Send replies of another transaction, protocol or unit."""
    row = Row("9", "replies with a wrong transaction number, protocol or unit")
    _wires(row, ("transaction", "protocol"), trials // 2, seed, ("tcp",))
    return _wires(row, ("unit",), trials // 2, seed)


def wrong_replies(_folder: Path, trials: int, seed: int) -> Row:
    """Well-formed replies that are wrong."""
    row = Row(
        "10", "replies with a wrong function or count, exceptions, words swapped, bits flipped"
    )
    return _wires(row, ("function", "count", "word-swap", "mutate", "exception"), trials, seed)


def disorder(_folder: Path, trials: int, seed: int) -> Row:
    """Send replies twice, too late, in another order."""
    row = Row("11", "replies twice, of before, in another order, late, not at all")
    return _wires(row, ("duplicate", "stale", "reorder", "drop"), trials, seed)


def noise(_folder: Path, trials: int, seed: int) -> Row:
    """Line noise, one bit in a thousand."""
    return _wires(Row("12", "line noise, one bit in a thousand"), ("noise",), trials, seed)


def pieces(_folder: Path, trials: int, seed: int) -> Row:
    """Frames cut short, bytes before them."""
    return _wires(
        Row("13", "frames cut short; bytes before them"), ("truncate", "garbage"), trials, seed
    )


def slow_replies(_folder: Path, trials: int, seed: int) -> Row:
    """Send replies a byte at a time, slower than the deadline."""
    row = Row("14", "replies that come a byte each 0.5 s")
    return _wires(row, ("slow-loris",), trials, seed, ("tcp",))


def cuts(_folder: Path, trials: int, seed: int) -> Row:
    """End connections before the reply."""
    row = Row("15", "connections that are closed or reset before the reply")
    return _wires(row, ("fin", "reset"), trials, seed, ("tcp",))


def gaps(folder: Path, trials: int, seed: int) -> Row:
    """Lose scans in the device: rows of NaN, exactly as many, at their place."""
    from hdbench.devices.bench import Block
    from hdbench.filter import preset
    from hdbench.records.counted import survey_samples
    from hdbench.records.journal import JournalWriter
    from hdbench.session.recorder import TraceRecorder

    row = Row("18", "scans lost in the device, anywhere, any number")
    chance, profile = random.Random(seed), replies.PROFILE
    model = preset("report-6", profile)
    for number in range(trials):
        path = folder / f"gaps-{number}.hdj"
        writer = JournalWriter(path)
        recorder = TraceRecorder(profile, 6.6, model, writer, 1e-3, clock=lambda: 0.0)
        recorder.begin(None)
        index, lost, gone = 0, 0, set[int]()
        for _ in range(chance.randint(1, 12)):
            missing, n = chance.choice((0, 0, 1, chance.randint(1, 300))), chance.randint(0, 22)
            gone.update(range(index, index + missing))
            first = index + missing
            values = np.arange(first, first + n, dtype=float)
            level = np.zeros(n)
            recorder.add(
                Block(first, missing, values, level, level, level, values.astype(np.int64),
                      np.zeros(n, dtype=bool), running=True, watchdog_tripped=False, depth=0)
            )  # fmt: skip
            index, lost = first + n, lost + missing
        writer.close()
        trace = survey_samples(path).trace("gaps") if index else None
        path.unlink()
        if trace is None:
            row.add("", None, 0)
            continue
        empty = set(np.flatnonzero(np.isnan(trace["torque_v"])).tolist())
        exact = empty == gone and recorder.lost == lost and len(trace) == index
        kept = np.array_equal(trace["torque_v"][sorted(set(range(index)) - gone)],
                              [n for n in range(index) if n not in gone])  # fmt: skip
        row.add("" if exact and kept else f"{len(empty)} rows empty, {lost} lost", None, 0)
    return row
