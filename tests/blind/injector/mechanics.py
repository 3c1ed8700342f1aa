"""All families of friction, sensor, dynamics and slow changes."""

from .friction import FRICTION
from .slow import SLOW
from .static import CROSSTALK, STATIC

__all__ = ["MECHANICS"]

MECHANICS = (*FRICTION, *STATIC, *SLOW, *CROSSTALK)
