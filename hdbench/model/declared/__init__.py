"""Causes of a user's own, declared as data."""

from __future__ import annotations

from hdbench.model.declared.causefile import declared_cause, load_causes

__all__ = ["declared_cause", "load_causes"]
