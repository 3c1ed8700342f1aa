"""Nothing stays open, emulators are forks."""

from forked import warm_emulators  # noqa: F401
from leftovers import nothing_stays_open, patient_control  # noqa: F401
