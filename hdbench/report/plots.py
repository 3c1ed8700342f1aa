"""Pictures of their own, as SVG or PNG files: response, orders, comparison."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from hdbench.errors import UsageError
from hdbench.records import FloatArray, write_atomic
from hdbench.report.canvas import min_max
from hdbench.report.texts import TEMPLATES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STYLE: Any = mpl.rc_params_from_file(TEMPLATES / "plot.mplstyle", use_default_template=False)


def _figure(rows: int, height_in: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(7.0, height_in), layout="constrained")
    grid = figure.subplots(rows, 1, squeeze=False)
    return figure, [grid[i, 0] for i in range(rows)]


def _save(figure: Figure, path: Path) -> None:
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("svg", "png"):
        raise UsageError(
            f"{path} is neither .svg nor .png", where="--plot", fix="name a file of that kind"
        )
    buffer = io.BytesIO()
    metadata = {"Date": None, "Creator": None} if kind == "svg" else {"Software": None}
    figure.savefig(buffer, format=kind, dpi=150, metadata=metadata)
    write_atomic(path, buffer.getvalue())


def plot_response(path: Path, name: str, responses: Sequence[Mapping[str, Any]]) -> None:
    """Draw gain and phase from measured to filtered torque."""
    with mpl.rc_context(_STYLE):
        figure, (gain, phase) = _figure(2, 5.6)
        for response in responses:
            curve = response["curve"]
            hz = np.array(curve["frequency_hz"])
            label = f"{response['velocity_rad_s']:g} rad/s"
            # a notch is exactly zero; 1e-5 is where a picture ends
            gain.loglog(hz, np.maximum(np.array(curve["gain"]), 1e-5), label=label)
            phase.semilogx(hz, np.degrees(np.array(curve["phase_rad"])), label=label)
        gain.set_ylim(1e-3, 5.0)
        gain.set_ylabel("|H|, filtered over measured")
        gain.set_title(f"{name}: what is left of the torque", loc="left")
        gain.legend()
        phase.set_ylabel("phase (degrees)")
        phase.set_xlabel("frequency (Hz)")
        _save(figure, path)


def plot_orders(
    path: Path,
    spectrum: tuple[FloatArray, FloatArray],
    waves: Mapping[str, tuple[FloatArray, FloatArray, FloatArray]],
) -> None:
    """Draw the order spectrum, and every order's amplitude over time with its band."""
    with mpl.rc_context(_STYLE):
        figure, (above, below) = _figure(2, 6.0)
        x, y = min_max(*spectrum)
        above.semilogy(x, np.maximum(y, 1e-9), color="#1f4e79")
        largest = float(np.max(spectrum[1], initial=1e-9))
        above.set_ylim(max(largest * 1e-5, 1e-9), 2.0 * largest)
        above.set_xlabel("order (cycles per motor turn)")
        above.set_ylabel("amplitude (N·m)")
        for name, (time, amplitude, std) in waves.items():
            step = max(1, time.size // 2000)
            line = below.plot(time[::step], amplitude[::step], label=name)[0]
            low, high = amplitude - 2.0 * std, amplitude + 2.0 * std
            below.fill_between(
                time[::step], low[::step], high[::step], color=line.get_color(), alpha=0.2, lw=0
            )
        below.set_xlabel("time (s)")
        below.set_ylabel("amplitude (N·m), band of 2 std")
        below.set_ylim(bottom=0.0)
        below.legend(ncols=3)
        _save(figure, path)


def plot_comparison(path: Path, time_s: FloatArray, torques: Mapping[str, FloatArray]) -> None:
    """Draw torques over time, one below the other."""
    with mpl.rc_context(_STYLE):
        figure, axes = _figure(len(torques), 1.5 * len(torques) + 0.6)
        for ax in axes[1:]:
            ax.sharey(axes[0])
        for ax, (name, torque) in zip(axes, torques.items(), strict=True):
            ax.plot(*min_max(time_s, torque), linewidth=0.8, color="#1f4e79")
            ax.set_title(name, loc="left", fontsize=9.5)
            ax.set_ylabel("N·m")
        axes[-1].set_xlabel("time (s)")
        _save(figure, path)
