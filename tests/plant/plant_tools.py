"""Profiles and plants for the plant's tests."""

from typing import Any

from changing import REPORT, with_keys

from hdbench.plant.bench import SimulatedBench
from hdbench.plant.converter import RawSamples
from hdbench.plant.plantfile import PlantFile, PlantSpec, load_plant
from hdbench.profile import ProfileData
from hdbench.profile.schema import ReferenceWave


def profile(**changes: dict[str, Any]) -> ProfileData:
    """Return the report's bench with keys of its tables replaced."""
    return with_keys(REPORT, **changes)


def quiet_profile(**changes: dict[str, Any]) -> ProfileData:
    """Return the report's bench without noise."""
    sensor = {"noise_nm": 0.0, **changes.pop("sensor", {})}
    tacho = {"noise_v": 0.0, **changes.pop("tacho", {})}
    return profile(sensor=sensor, tacho=tacho, **changes)


def plant(**keys: Any) -> PlantSpec:
    """Return a plant from the keys of its file."""
    return PlantSpec(PlantFile.model_validate({"name": "test", **keys}), "")


def constant(volt: float) -> ReferenceWave:
    return ReferenceWave(wave="constant", bias_v=volt)


def run(
    bench: SimulatedBench, wave: ReferenceWave | None, n: int, period_s: float = 1e-3
) -> RawSamples:
    bench.begin(sample_period_s=period_s, wave=wave, duration_s=n * period_s)
    return bench.advance(n)


AS_MODELLED = load_plant("as-modelled")
WORN = load_plant("worn")
V_PER_CODE = 10.0 / 32768.0
NM_PER_CODE = 6.6 * V_PER_CODE
