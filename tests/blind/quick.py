"""The quick form: forty records on fixed seeds, short enough for every run of the tests."""

from injector.build import Case, Hidden
from injector.loads import LOAD_FAMILIES

__all__ = ["CLEAN", "DYNAMIC", "LOADS"]

_SEED = 41000
_NAMES = (
    "ripple-harmonic", "motor-unbalance", "structural-tone", "coulomb-friction",
    "viscous-friction", "gain-error", "cubic-nonlinearity", "hysteresis", "zero-step",
    "position-dependent-gain",
)  # fmt: skip

CLEAN = tuple(
    Case(f"quick-clean-{k}", "A", "compact", noise, seed=_SEED + k)
    for k, noise in enumerate(("white", "ar", "white", "ar"))
)
DYNAMIC = tuple(
    Case(f"quick-{name}", "B", "compact", ("white", "ar")[k % 2], seed=_SEED + 100 + k,
         hidden=(Hidden(name, "d20"),))
    for k, name in enumerate(_NAMES)
)  # fmt: skip
LOADS = tuple(
    Case(f"quick-loads-{name or 'clean'}-{k}", "L", "loads", sigma_nm=0.005,
         seed=_SEED + 200 + 10 * k + len(name), hidden=(Hidden(name, tier),) if name else ())
    for k, tier in enumerate(("d20", "high"))
    for name in (*LOAD_FAMILIES, "", "", "", "")
)  # fmt: skip
