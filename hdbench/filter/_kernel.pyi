import numpy as np
from numpy.typing import NDArray

from hdbench.records import FloatArray

def run(
    model: FloatArray,
    state: FloatArray,
    samples: tuple[FloatArray, FloatArray, FloatArray, FloatArray | None],
    outputs: tuple[FloatArray, ...],
    flags: NDArray[np.uint8],
    sums: FloatArray,
    /,
) -> int: ...
def batch(
    model: FloatArray,
    samples: tuple[FloatArray, FloatArray, FloatArray, FloatArray | None],
    outputs: tuple[FloatArray | None, ...],
    sums: FloatArray,
    /,
) -> int: ...
def smooth(
    model: FloatArray,
    samples: tuple[FloatArray, FloatArray, FloatArray, FloatArray | None],
    expected: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
    /,
) -> int: ...
