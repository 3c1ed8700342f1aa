"""Published implementations on the same library of terms, where they are installed."""

import importlib.util

import numpy as np


def terms_of(names, blocks):
    matrix = np.column_stack(blocks)
    owners = [name for name, block in zip(names, blocks, strict=True) for _ in block.T]
    return matrix / np.linalg.norm(matrix, axis=0), owners


def _pysindy(rest, names, blocks):
    """STLSQ of pysindy on the residual; threshold 5 of the noise's standard deviations."""
    from pysindy.optimizers import STLSQ

    matrix, owners = terms_of(names, blocks)
    found = STLSQ(threshold=5.0 * float(rest.std()), alpha=1e-6).fit(matrix, rest[:, None])
    kept = np.flatnonzero(np.abs(np.ravel(found.coef_)) > 0.0)
    return [owners[k] for k in kept]


def _sysidentpy(rest, names, blocks):
    """FROLS of sysidentpy: terms at lag 1 of inputs moved by one sample, order by BIC, up to 5."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    matrix, owners = terms_of(names, blocks)
    # every tenth sample: its matrices are dense over all terms and candidates
    ahead = np.vstack([matrix[1:], matrix[-1:]])[::10] * 100.0
    model = FROLS(
        order_selection=True, n_info_values=5, info_criteria="bic", ylag=1,
        xlag=[[1]] * matrix.shape[1], basis_function=Polynomial(degree=1),
        estimator=LeastSquares(), model_type="NFIR",
    )  # fmt: skip
    model.fit(X=ahead, y=rest[::10, None])
    codes = np.asarray(model.final_model).ravel()
    return [owners[int(code) // 1000 - 2] for code in codes if code >= 2000]


INSTALLED = {
    name: method
    for name, module, method in (
        ("pysindy STLSQ", "pysindy", _pysindy),
        ("sysidentpy FROLS", "sysidentpy", _sysidentpy),
    )
    if importlib.util.find_spec(module) is not None
}
