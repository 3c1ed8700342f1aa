"""Faults of the disk: full, failing, refused, pulled; and a process killed while it writes.

A full or failing disk is made by a few lines of C (`shim.c`) loaded before the C library:
the n-th write or sync below the run's folder fails, for every n from the first. Needs a C compiler.
"""

from __future__ import annotations

import ctypes
import errno
import json
import os
import random
import shutil
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from faults.kit import Row, acknowledging, begin, preloaded, served, short_profile
from hdbench.profile import Profile

__all__ = ["failing_disks", "full_disks", "killed_writes", "power_cuts", "refusals"]


def full_disks(folder: Path, trials: int, _seed: int) -> Row:
    """ENOSPC from the n-th write on, until the reserve is given back."""
    row = Row("6", "disk full from the n-th write on, n = 1, 2, ...")
    order = {"error": errno.ENOSPC, "stay": 1, "syncs": 0, "trials": trials}
    return _worked(row, folder, [order])


def failing_disks(folder: Path, trials: int, _seed: int) -> Row:
    """EIO at the n-th write, then at the n-th sync; each once, and from then on.

    Four fifths of the trials are writes, as a run has many more of them.
    """
    row = Row("7", "EIO at the n-th write or the n-th sync, n = 1, 2, ...; once, or from then on")
    orders = [
        {"error": errno.EIO, "stay": stay, "syncs": syncs, "trials": max(1, trials * share // 10)}
        for syncs, share in ((0, 4), (1, 1))
        for stay in (0, 1)
    ]
    return _worked(row, folder, orders)


def _worked(row: Row, folder: Path, orders: list[dict[str, int]]) -> Row:
    profile = short_profile(folder)
    with served(folder, profile, "fast") as bench:
        place = folder / f"disk-{time.monotonic_ns()}"
        place.mkdir()
        asked = {
            "orders": orders, "address": bench.address, "profile": str(profile),
            "place": str(place),
        }  # fmt: skip
        trials = sum(order["trials"] for order in orders)
        for line in preloaded(row, folder, "shim.c", [__file__, json.dumps(asked)], trials):
            row.count(f"exit {line['code']}")
            row.add(str(line["problem"]), None, int(str(line["lost"])))
        _, _, moving = bench.after(time.monotonic())
        if moving:
            row.add(moving)
    return row


def _worker(asked: dict[str, object]) -> None:
    """Run the trials in this process, which has the shim."""
    from hdbench.profile import load_profile

    counter = acknowledging()
    counter.install()
    profile = load_profile(str(asked["profile"]))
    orders = asked["orders"]
    for order in orders if isinstance(orders, list) else ():
        for number in range(order["trials"]):
            out = Path(str(asked["place"])) / f"{order['stay']}-{order['syncs']}-{number}"
            out.mkdir()
            counter.reset()
            code, words = _tried(out, profile, str(asked["address"]), (order, number))
            lost, problem = _judge(out, counter.count, code, words, bool(order["stay"]))
            print(json.dumps({"code": code, "lost": lost, "problem": problem}), flush=True)
            shutil.rmtree(out)


def _tried(
    out: Path, profile: Profile, address: str, fault: tuple[dict[str, int], int]
) -> tuple[int, str]:
    """Run the experiment with the fault armed; return the exit code and what was said."""
    from hdbench.errors import HdbenchError
    from hdbench.session import BenchOptions, run_experiment
    from hdbench_cli.asking.operator import ConsoleOperator

    order, number = fault
    shim = ctypes.CDLL(None)
    shim.fault_arm(str(out).encode(), number, order["error"], order["stay"], order["syncs"])
    try:
        person = ConsoleOperator(motion_confirmed=True)
        options = BenchOptions(out, address=address, operator=person)
        run_experiment("ripple", profile, options, lambda _what, _share: None)
    except HdbenchError as error:
        return error.exit_code, error.what
    except OSError as error:
        # what the command line makes of it
        return 7, str(error)
    finally:
        shim.fault_disarm()
    return 0, ""


def _judge(out: Path, count: int, code: int, words: str, stays: bool) -> tuple[int, str]:
    from hdbench.records.counted import summarize_journal

    journal = next(iter(out.glob("*/journal.hdj")), None)
    kept = summarize_journal(journal).samples if journal else 0
    lost = max(0, count - kept)
    manifest = next(iter(out.glob("*/run.json")), None)
    status = json.loads(manifest.read_text())["status"] if manifest else "none"
    # a disk that stays dead keeps the old run.json; the run reads as incomplete all the same
    told = status != "running" or (stays and "No space" not in words)
    problem = "" if code in (0, 7) else f"exit {code}: {words}"
    problem = problem or (f"{lost} samples lost" if lost else "")
    return lost, problem or ("" if told else f"run.json says {status} after: {words}")


def refusals(folder: Path, trials: int, _seed: int) -> Row:
    """No folder, no room, a quota: told before anything moves, or with everything kept."""
    row = Row(
        "8", "a file in the folder's place; a missing device; files of at most 64 kB (RLIMIT_FSIZE)"
    )
    profile = short_profile(folder)
    blocked = folder / "a-file"
    blocked.write_text("")
    with served(folder, profile, "fast") as bench:
        base = ["run-ripple", "--profile", str(profile), "--yes", "--no-report"]
        for number in range(trials):
            kind = number % 3
            words = [*base, "--address", bench.address if kind else "tcp://127.0.0.1:9"]
            bench.mark()
            if kind == 1:
                run = begin(folder, ["export", "--model", "report-6", "--out", str(blocked / "x")])
            else:
                run = begin(folder, words, limit_bytes=65536 if kind else None)
            code = run.wait(40.0)
            allowed = {0: (5, 8), 1: (2, 4, 7), 2: (7,)}[kind]
            traceback = "Traceback" in run.words()
            row.count(f"exit {code}")
            row.add(
                ""
                if code in allowed and not traceback
                else f"{kind}: exit {code} {run.words()[-200:]}"
            )
            _, _, moving = bench.after(time.monotonic())
            if moving:
                row.add(moving)
    return row


def power_cuts(folder: Path, trials: int, seed: int) -> Row:
    """Images of a journal after a power cut: what was not synced is torn, zeroed, or gone."""
    import numpy as np

    from hdbench.errors import DataError
    from hdbench.records.journal import JournalWriter, read_journal

    row = Row("5", "power cut: journals whose unsynced sectors are missing, zeroed or torn")
    path, image = folder / "cut.hdj", folder / "image.hdj"
    sizes = []
    with JournalWriter(path) as writer:
        for number in range(60):
            time_s = np.arange(22) * 1e-3 + number
            writer.append("samples", {"time_s": time_s, "torque_v": np.sin(time_s)})
            sizes.append(path.stat().st_size)
    raw, chance = path.read_bytes(), random.Random(seed)
    whole = read_journal(path).blocks
    for _ in range(trials):
        synced = chance.randrange(len(sizes))
        tail = bytearray(raw[sizes[synced] : sizes[min(len(sizes) - 1, synced + 3)]])
        for sector in range(0, len(tail), 512):
            fate = chance.randrange(3)
            if fate:
                torn = bytes(512) if fate == 1 else chance.randbytes(512)
                tail[sector : sector + 512] = torn[: len(tail) - sector]
        image.write_bytes(raw[: sizes[synced]] + bytes(tail[: chance.randint(0, len(tail))]))
        try:
            found = read_journal(image).blocks
        except DataError as error:
            row.add(f"refused: {error.what}", None, synced + 1)
            continue
        same = all(
            np.array_equal(found[n].columns["torque_v"], whole[n].columns["torque_v"])
            for n in range(min(len(found), synced + 1))
        )
        lost = max(0, synced + 1 - len(found))
        row.add("" if same and not lost else f"{lost} blocks lost, same: {same}", None, 22 * lost)
    return row


def killed_writes(folder: Path, trials: int, seed: int) -> Row:
    """SIGKILL while a file is replaced: the old one or the new one stands there."""
    import signal

    from hdbench.records.storage import write_atomic

    row = Row("27", "SIGKILL while a report or result is replaced")
    path, chance = folder / "result.json", random.Random(seed)
    versions = [bytes([65 + n]) * 400_000 for n in range(4)]
    for _ in range(trials):
        write_atomic(path, versions[0])
        pid = os.fork()
        if not pid:
            number = 0
            while True:
                number += 1
                write_atomic(
                    path, (versions[number % 4][at : at + 4096] for at in range(0, 400_000, 4096))
                )
        time.sleep(chance.uniform(0.0, 0.05))
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        found = path.read_bytes()
        row.add("" if found in versions else f"{len(found)} bytes of neither")
    return row


if __name__ == "__main__":
    _worker(json.loads(sys.argv[1]))
