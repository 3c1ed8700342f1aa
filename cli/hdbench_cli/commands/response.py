"""`hdbench response`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hdbench.filter.presets import choose_filter
from hdbench.filter.response import filter_response, inject
from hdbench.profile import Profile
from hdbench_cli.inputs import choose_profile
from hdbench_cli.output import Output
from hdbench_cli.text import Lines, table

_INJECTED_HZ = (0.0, 0.5, 2.0, 10.0)


def _speeds(profile: Profile) -> tuple[float, float]:
    """Return the speeds of the bench's two dynamic experiments, rad/s."""
    ripple = profile.data.ripple.reference
    fast = abs(ripple.amplitude_v) * profile.data.servo.velocity_gain_rad_s_per_v
    return abs(profile.data.misalignment.velocity_rad_s), fast


def response_command(
    output: Output,
    filter_name: str | None,
    velocities: tuple[float, ...],
    period_s: float | None,
    plot: Path | None,
    profile_name: str | None,
) -> None:
    """Show what a tuning does to the torque: notches, torque passed, noise, memory."""
    profile = choose_profile(profile_name, None)
    model = choose_filter(profile, filter_name)
    period = period_s or profile.data.daq.sample_period_s
    injected = [f for f in _INJECTED_HZ if f < 0.5 / period]
    responses = []
    for velocity in velocities or _speeds(profile):
        item = filter_response(model, velocity, period).to_dict()
        item["injection"] = [asdict(p) for p in inject(model, velocity, period, injected)]
        responses.append(item)
    body = {"sample_period_s": period, "responses": responses, "filter": model.to_dict()}
    if plot is not None:
        from hdbench.report.plots import plot_response

        plot_response(plot, model.name, responses)
        body["plot"] = str(plot)
    output.result(body, _lines(body), kind="response", profile=profile)


def _lines(body: Mapping[str, Any]) -> Lines:
    for item in body["responses"]:
        settling = item["settling_time_s"]
        memory = "never" if settling is None else f"{settling:.3g} s"
        yield (
            f"{body['filter']['name']} at {item['velocity_rad_s']:g} rad/s: "
            f"white noise times {item['noise_gain']:.3f}, settled to 2 % after {memory}"
        )
        injected = {p["frequency_hz"]: f"{p['measured']:.3f}" for p in item["injection"]}
        rows = (
            (
                f"{p['frequency_hz']:g} Hz",
                f"{p['gain']:.3f}",
                injected.get(p["frequency_hz"], ""),
                f"{math.degrees(p['phase_rad']):+.1f} deg",
            )
            for p in item["passed"]
        )
        yield table(("frequency", "|H|", "|H| by injection", "phase"), rows)
        for n in item["notches"]:
            width = "none: half power is not reached on both sides before the next notch"
            if n["width_hz"] is not None:
                width = f"{n['width_hz']:.3g} Hz"
            at = f"{n['frequency_hz']:.4g} Hz, {n['depth_db']:.0f} dB"
            yield f"notch {n['name']} at {at}, width {width}"
    if "plot" in body:
        yield f"picture: {body['plot']}"
