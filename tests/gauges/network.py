"""A resistor network solved by its node voltages: knows no bridge formula."""

import numpy as np


def node_voltages(edges: list[tuple[str, str, float]], fixed: dict[str, float]) -> dict[str, float]:
    """Return the voltage of every node from Kirchhoff's current law."""
    names = sorted({name for a, b, _ in edges for name in (a, b)})
    place = {name: i for i, name in enumerate(names)}
    matrix, right = np.zeros((len(names), len(names))), np.zeros(len(names))
    for a, b, ohm in edges:
        i, j = place[a], place[b]
        for row, other in ((i, j), (j, i)):
            matrix[row, row] += 1.0 / ohm
            matrix[row, other] -= 1.0 / ohm
    for name, volts in fixed.items():
        matrix[place[name]] = 0.0
        matrix[place[name], place[name]] = 1.0
        right[place[name]] = volts
    return dict(zip(names, np.linalg.solve(matrix, right), strict=True))


def bridge_output(strain: np.ndarray, gauge_factor: float, supply_v: float) -> float:
    """Return the output of the bridge of one strain array, shape (rosettes, 2), V.

    Arms run supply - 1 - right - 2 - ground and ground - 3 - left - 4 - supply, so that 1 and 3 lie
    opposite; gauges of an arm are in series with nodes of their own between them.
    """
    arms = {
        1: ("plus", "left", strain[0::2, 0]),
        2: ("left", "ground", strain[0::2, 1]),
        3: ("right", "ground", strain[1::2, 0]),
        4: ("plus", "right", strain[1::2, 1]),
    }
    edges = []
    for number, (start, end, strains) in arms.items():
        nodes = [start, *(f"{number}.{i}" for i in range(1, len(strains))), end]
        ohms = 350.0 * (1.0 + gauge_factor * strains)
        edges += list(zip(nodes[:-1], nodes[1:], ohms, strict=True))
    volts = node_voltages(edges, {"plus": supply_v, "ground": 0.0})
    # arm 1 stretched lowers the left node: the output is taken from right to left
    return volts["right"] - volts["left"]
