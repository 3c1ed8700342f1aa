"""Choice of the filter model for an experiment: by name, from results, or of the stored run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from hdbench.filter import (
    FilterModel,
    build_filter_model,
    filter_channels,
    load_filter_model,
)
from hdbench.profile import Profile
from hdbench.records.jsonfile import read_json
from hdbench.records.trace import Trace

if TYPE_CHECKING:
    from hdbench.filter import TuningResult, TuningSettings


# name of the filter that is tuned on the very input
TUNED = "tuned"


def choose_filter(
    profile: Profile,
    name: str | None,
    *,
    misalignment: Path | None = None,
    source: Path | None = None,
) -> FilterModel:
    """Return the filter that was asked for."""
    stored = None if name or source is None else stored_filter(source, profile)
    base = stored or load_filter_model(name or profile.data.filter.model, profile.data)
    if misalignment is None:
        return base
    file = misalignment / "result.json" if misalignment.is_dir() else misalignment
    result = read_json(file, "hdbench/misalignment/1")
    return build_filter_model(base, ripple=None, misalignment=result, calibration=None)


def tune_traces(
    profile: Profile,
    base: FilterModel,
    traces: Sequence[Trace],
    origins: Mapping[str, str],
    settings: TuningSettings | None = None,
) -> TuningResult:
    """Tune a filter on traces."""
    from hdbench.filter import tune
    from hdbench.filter.tuning.run import settings_of

    channels = [filter_channels(trace, profile.data, use_measured_angle=True) for trace in traces]
    measured = replace(base, use_measured_angle=True)
    return tune(measured, channels, settings or settings_of(profile.data), origins=dict(origins))


def stored_filter(source: Path, profile: Profile) -> FilterModel | None:
    """Return the filter that ran while a run was sampled."""
    manifest = source / "run.json"
    if not manifest.is_file():
        return None
    body = read_json(manifest)
    own, model = body.get("profile"), body.get("filter")
    if not (isinstance(own, dict) and own.get("sha256") == profile.sha256):
        return None
    if not isinstance(model, dict):
        return None
    return FilterModel.from_dict(model, source=f"{manifest}: filter")
