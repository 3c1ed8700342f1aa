"""One bench as TOML: read, checked, frozen."""

from __future__ import annotations

from hdbench.profile.loader import (
    Profile,
    check_loads,
    check_profiles,
    list_profiles,
    load_profile,
    new_profile,
    parse_profile,
    profile_schema,
    stored_profile,
)
from hdbench.profile.schema import ProfileData

__all__ = [
    "Profile",
    "ProfileData",
    "check_loads",
    "check_profiles",
    "list_profiles",
    "load_profile",
    "new_profile",
    "parse_profile",
    "profile_schema",
    "stored_profile",
]
