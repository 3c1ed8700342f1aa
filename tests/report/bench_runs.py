"""Run folders for the tests of the report, from traces that share no code with hdbench."""

import sys
from pathlib import Path

import numpy as np

from hdbench.evaluation import evaluate
from hdbench.filter import OnlineFilter, preset
from hdbench.profile import Profile
from hdbench.records import Quantity, TorqueScale, Trace
from hdbench.records.jsonfile import result_header, write_json
from hdbench.records.loads import read_loads
from hdbench.records.runfolder import RunFolder
from hdbench.records.tracefile import read_trace, write_trace

sys.path.insert(0, str(Path(__file__).parents[1] / "stored"))
import generate

__all__ = ["calibration_run", "diagnosis_run", "dynamic_run", "generate", "new_run", "trace_of"]
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


def dynamic_run(parent: Path, kind: str, profile: Profile, trace: Trace) -> Path:
    run = new_run(parent, kind, profile)
    write_trace(run.trace, online(trace, profile))
    model = preset("report-6", profile.data)
    write_json(run.result, evaluate(kind, trace, profile, scale=SCALE, model=model).to_json())
    run.finish("complete", "done", [run.trace, run.result])
    return run.path


def calibration_run(parent: Path, profile: Profile, text: str) -> Path:
    run = new_run(parent, "calibration", profile)
    run.loads.write_text(text)
    loads = read_loads(run.loads, profile.data.arm)
    model = preset("report-6", profile.data)
    write_json(
        run.result,
        evaluate(
            "calibration", loads, profile, scale=SCALE, model=model, max_consistency=0.05
        ).to_json(),
    )
    run.finish("complete", "done", [run.loads, run.result])
    return run.path


def diagnosis_run(parent: Path, profile: Profile, cause: dict[str, object]) -> Path:
    run = new_run(parent, "diagnosis", profile)
    rng = np.random.default_rng(3)
    time = np.arange(6000) * 1e-3
    angle = 156.0 * time
    noise = rng.normal(0.0, 0.05, len(time))
    simulated = 0.4 * np.cos(2.0 * angle) + 0.9 * np.cos(angle / 100.0)
    extra = 0.15 * np.cos(6.0 * angle + 0.4)
    columns = {
        "time_s": time,
        "measured_nm": simulated + extra + noise,
        "simulated_nm": simulated,
        "extended_nm": simulated + extra,
        "residual_before_nm": extra + noise,
        "residual_after_nm": noise,
        "masked": (time > 4.0) * (time < 4.1) * 1.0,
    }
    _table(run.path / "residual.csv", columns)
    for name, place, rate in (
        ("order", "motor_order", 156.0 / (2.0 * np.pi)),
        ("frequency", "frequency_hz", 1.0),
    ):
        line = {
            key: np.abs(np.fft.rfft(columns[key])) * 2.0 / len(time)
            for key in ("residual_before_nm", "residual_after_nm")
        }
        table = {
            place: np.fft.rfftfreq(len(time), 1e-3) / rate,
            "before_nm": line["residual_before_nm"],
            "after_nm": line["residual_after_nm"],
        }
        _table(run.path / f"{name}_spectrum.csv", table)
    body = {
        "verdict": "named",
        "causes": [cause],
        "minor": [],
        "unexplained": [],
        "data_flags": [{"name": "spikes", "from_s": 4.0, "to_s": 4.1, "samples": 99}],
        "minimum_detectable": [{"name": "mains-hum", "amplitude_nm": 0.004}],
        "simulated": {"terms": ["zero"], "heldout_rms_nm": 0.1177},
        "extended": {"terms": ["zero", "ripple-harmonic"], "heldout_rms_nm": 0.0502},
        "model_file": "model.json",
    }
    write_json(run.result, {**result_header("diagnosis", profile), **body})
    run.finish("complete", "done", [run.result, run.path / "residual.csv"])
    return run.path


def _table(path: Path, columns: dict[str, np.ndarray]) -> None:
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(f"{x:.6g}" for x in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
