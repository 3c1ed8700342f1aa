"""Emulators are forks."""

from forked import warm_emulators  # noqa: F401
