"""The guard: a small process of its own that stops the motor when the session cannot."""

from __future__ import annotations

from hdbench.devices.guard.bench import GuardedBench, GuardProcess, guard_silence_s
from hdbench.devices.guard.order import GuardOrder, order_of

__all__ = ["GuardOrder", "GuardProcess", "GuardedBench", "guard_silence_s", "order_of"]
