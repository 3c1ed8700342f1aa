"""Tasks whose worker dies, run as a program: what a worker imports must be a module of its own."""

import json
import os
import signal
import sys
from pathlib import Path

from hdbench.batch import Workers, run_tasks


def die_by_number(task: tuple[str, int]) -> int:
    """Kill the worker: task 1 at its first try, task 2 at every try."""
    folder, number = task
    tries = len(list(Path(folder).glob(f"{number}-*")))
    (Path(folder) / f"{number}-{tries}").touch()
    if number == 2 or (number == 1 and tries == 0):
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * number


if __name__ == "__main__":
    tasks = [(sys.argv[1], number) for number in range(5)]
    outcomes = run_tasks(die_by_number, tasks, Workers(count=2, retries=1))
    told = {o.task[1]: (o.value, o.deaths, o.lost) for o in outcomes}
    sys.stdout.write(json.dumps([told[number] for number in range(5)]))
