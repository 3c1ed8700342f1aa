"""Run folders for the tests of the report, from traces that share no code with hdbench."""

from pathlib import Path
from typing import Any

import numpy as np

from hdbench.evaluation import evaluate
from hdbench.filter import OnlineFilter, preset
from hdbench.profile import Profile
from hdbench.records import Loads, Quantity, TorqueScale, Trace
from hdbench.records.jsonfile import result_header, write_json
from hdbench.records.loads import read_loads
from hdbench.records.runfolder import RunFolder
from hdbench.records.tracefile import read_trace, write_trace

SCALE = TorqueScale(Quantity(6.6, 0.03, 3.0), "calibration 20260101T000000Z-calibration-abc123")


def trace_of(text: str, folder: Path) -> Trace:
    file = folder / "raw.csv"
    file.write_text(text)
    return read_trace(file)


def new_run(parent: Path, kind: str, profile: Profile) -> RunFolder:
    parent.mkdir(exist_ok=True)
    details = {
        "calibration": SCALE.to_dict(),
        "filter": preset("report-6", profile.data).to_dict(),
        "simulation": {"plant": "as-modelled", "seed": 0},
    }
    return RunFolder.create(parent, kind=kind, profile=profile, details=details)


def online(trace: Trace, profile: Profile) -> Trace:
    velocity = trace["tacho_v"] * profile.data.tacho.gain_rad_s_per_v
    torque = trace["torque_v"] * SCALE.gain_nm_per_v.value
    found = OnlineFilter(preset("report-6", profile.data)).process(trace.time_s, velocity, torque)
    return trace.with_columns(torque_filtered_online_nm=found.torque_filtered_nm)


def finished(run: RunFolder, result: dict[str, Any], data: Path) -> Path:
    """End a run with its result and its data; return its folder."""
    write_json(run.result, result)
    run.finish("complete", "done", [data, run.result])
    return run.path


def evaluated(kind: str, records: Trace | Loads, profile: Profile) -> dict[str, Any]:
    model = preset("report-6", profile.data)
    return evaluate(kind, records, profile, scale=SCALE, model=model).to_json()


def dynamic_run(parent: Path, kind: str, profile: Profile, trace: Trace) -> Path:
    run = new_run(parent, kind, profile)
    write_trace(run.trace, online(trace, profile))
    return finished(run, evaluated(kind, trace, profile), run.trace)


def calibration_run(parent: Path, profile: Profile, text: str) -> Path:
    run = new_run(parent, "calibration", profile)
    run.loads.write_text(text)
    loads = read_loads(run.loads, profile.data.arm)
    return finished(run, evaluated("calibration", loads, profile), run.loads)


def diagnosis_run(parent: Path, profile: Profile, cause: dict[str, object]) -> Path:
    run = new_run(parent, "diagnosis", profile)
    noise = np.random.default_rng(3).normal(0.0, 0.05, 6000)
    time = np.arange(6000) * 1e-3
    angle = 156.0 * time
    simulated = 0.4 * np.cos(2.0 * angle) + 0.9 * np.cos(angle / 100.0)
    extra = 0.15 * np.cos(6.0 * angle + 0.4)
    left = {"before_nm": extra + noise, "after_nm": noise}
    table(
        run.path / "residual.csv",
        time_s=time,
        measured_nm=simulated + extra + noise,
        simulated_nm=simulated,
        extended_nm=simulated + extra,
        **{f"residual_{when}": values for when, values in left.items()},
        masked=(time > 4.0) * (time < 4.1) * 1.0,
    )
    lines = {when: np.abs(np.fft.rfft(values)) * 2.0 / len(time) for when, values in left.items()}
    place = np.fft.rfftfreq(len(time), 1e-3)
    table(run.path / "order_spectrum.csv", motor_order=place / (156.0 / (2.0 * np.pi)), **lines)
    table(run.path / "frequency_spectrum.csv", frequency_hz=place, **lines)
    body = {
        "verdict": "named",
        "causes": [cause],
        "data_flags": [{"name": "spikes", "from_s": 4.0, "to_s": 4.1, "samples": 99}],
        "minimum_detectable": [{"name": "mains-hum", "amplitude_nm": 0.004}],
        "simulated": {"terms": ["zero"], "heldout_rms_nm": 0.1177},
        "extended": {"terms": ["zero", "ripple-harmonic"], "heldout_rms_nm": 0.0502},
        "model_file": "model.json",
    }
    return finished(run, {**result_header("diagnosis", profile), **body}, run.path / "residual.csv")


def table(path: Path, **columns: np.ndarray) -> None:
    """Write columns of numbers as CSV."""
    body = np.column_stack([*columns.values()])
    np.savetxt(path, body, "%.6g", ",", header=",".join(columns), comments="")
