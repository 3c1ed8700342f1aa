"""The confusion of names as a picture."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt

__all__ = ["draw_confusion"]

_REST = ("unexplained", "nothing", "no answer")


def draw_confusion(counts: Counter[tuple[str, str]], path: Path) -> None:
    """Draw true families (rows) against answers (columns), shares of each row, to `path`."""
    families = sorted({true for true, _ in counts})
    answers = sorted({said for _, said in counts} - set(_REST) | set(families))
    columns = [*answers, *_REST]
    table = np.zeros((len(families), len(columns)))
    for (true, said), count in counts.items():
        table[families.index(true), columns.index(said)] = count
    totals = table.sum(axis=1, keepdims=True)
    shares = np.divide(table, totals, out=np.zeros_like(table), where=totals > 0)
    figure, axes = plt.subplots(figsize=(13.0, 11.0), layout="constrained")
    image = axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=8)
    labels = [f"{name} ({int(total)})" for name, total in zip(families, totals[:, 0], strict=True)]
    axes.set_yticks(range(len(families)), labels, fontsize=8)
    axes.set_xlabel("answered first (the true name where the reported set holds its group)")
    axes.set_ylabel("hidden (number of records)")
    axes.set_title("Single effects at 10 and 20 sigma and at middle and high physical sizes")
    for i, j in np.argwhere(shares > 0.0):
        colour = "white" if shares[i, j] > 0.5 else "black"
        axes.text(j, i, f"{int(table[i, j])}", ha="center", va="center", fontsize=6, color=colour)
    figure.colorbar(image, ax=axes, label="share of the row", shrink=0.6)
    figure.savefig(path, dpi=110)
    plt.close(figure)
