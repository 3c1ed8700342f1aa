"""Profiles and plants for the plant's tests."""

from typing import Any

from hdbench.plant.plantfile import PlantFile, PlantSpec, load_plant
from hdbench.profile import ProfileData, load_profile


def profile(**changes: dict[str, Any]) -> ProfileData:
    """Return the report's bench with keys of its tables replaced."""
    data = load_profile("cim-tr-97-06").data
    tables = {name: getattr(data, name).model_copy(update=new) for name, new in changes.items()}
    return data.model_copy(update=tables)


def quiet_profile(**changes: dict[str, Any]) -> ProfileData:
    """Return the report's bench without noise."""
    sensor = {"noise_nm": 0.0, **changes.pop("sensor", {})}
    tacho = {"noise_v": 0.0, **changes.pop("tacho", {})}
    return profile(sensor=sensor, tacho=tacho, **changes)


def plant(**keys: Any) -> PlantSpec:
    """Return a plant from the keys of its file."""
    return PlantSpec(PlantFile.model_validate({"name": "test", **keys}), "")


AS_MODELLED = load_plant("as-modelled")
WORN = load_plant("worn")
