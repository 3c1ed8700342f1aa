"""Faults of the acquisition: found, named, masked or modelled, so that the rest can be judged."""

from __future__ import annotations

from hdbench.diagnosis.acquisition.flags import DataFlag, flag_samples

__all__ = ["DataFlag", "flag_samples"]
