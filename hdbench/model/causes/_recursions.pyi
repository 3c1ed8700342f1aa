import numpy as np
from numpy.typing import NDArray

from hdbench.records import FloatArray

def first_order(decay: FloatArray, drive: FloatArray, out: FloatArray, /) -> None: ...
def second_order(
    above: FloatArray,
    below: FloatArray,
    starts: NDArray[np.uint8],
    values: FloatArray,
    out: FloatArray,
    /,
) -> None: ...
def resonance(
    wave: FloatArray,
    rate: FloatArray,
    decay: FloatArray,
    starts: NDArray[np.uint8],
    pole: FloatArray,
    out: FloatArray,
    /,
) -> None: ...
def plays(
    torque: FloatArray,
    radius: FloatArray,
    starts: NDArray[np.uint8],
    state: FloatArray,
    out: FloatArray,
    /,
) -> None: ...
