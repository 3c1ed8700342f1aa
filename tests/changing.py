"""The report's bench, and profiles with some keys changed."""

from typing import Any

from hdbench.profile import ProfileData, load_profile

REPORT = load_profile("cim-tr-97-06").data


def with_keys(data: ProfileData, **tables: dict[str, Any]) -> ProfileData:
    """Return a profile with keys of its tables replaced."""
    changed = {name: getattr(data, name).model_copy(update=new) for name, new in tables.items()}
    return data.model_copy(update=changed)
