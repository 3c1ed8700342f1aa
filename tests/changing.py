"""The report's bench, and profiles with some keys changed."""

from typing import Any

from hdbench.profile import ProfileData, load_profile

REPORT = load_profile("cim-tr-97-06").data


def with_keys(data: ProfileData, **tables: dict[str, Any]) -> ProfileData:
    """Return a profile with keys of its tables replaced."""
    changed = {name: getattr(data, name).model_copy(update=new) for name, new in tables.items()}
    return data.model_copy(update=changed)


def with_daq(keys: str, name: str = "cim-tr-97-06") -> str:
    """Return the text of a profile with other keys in its table ``[daq]``."""
    before, _, rest = load_profile(name).text.partition("[daq]\n")
    return f"{before}[daq]\n{keys}\n[limits]\n{rest.partition('[limits]')[2]}"
