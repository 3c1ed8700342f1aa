"""The public logs of the gallery: where each comes from, and the commands that a user types."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["SETS", "Log"]


@dataclass(frozen=True)
class Log:
    """One log.

    Parameters
    ----------
    name : str
        Its name in truth.json, or of its folder.
    title, source : str
        What it is, who measured it, under which licence.
    file : str
        Below HDBENCH_DATA.
    profile : str
        Name of the profile that the commands use.
    commands : tuple of str
        Words behind ``hdbench``; the last one tells the answer.
    keys : mapping of str to float
        Keys of the profile where truth.json has none.
    notes : tuple of str
        What a reader has to know.
    """

    name: str
    title: str
    source: str
    file: str
    profile: str
    commands: tuple[str, ...]
    keys: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


_UR10 = (
    "ROS 2 bag without metadata, effort in N m at the joint. "
    "unisa-acg/inverse-dynamics-solver, BSD-3-Clause."
)
_EMPS = (
    "Electro-mechanical positioning system: Janot, Gautier, Brunot, *Data set and "
    "reference models of EMPS*, 2019 "
    "(nonlinearbenchmark.org). 1 rad stands for 1 mm of travel and 1 N m for 1 N."
)
_COGGING = "Brushless motor under speed control. heitor-andrade/laas_anti_cogging, BSD-3-Clause."
_PREPARED = "The raw file is not at hand: this is the trace that was made of it."


def _ur10(joint: str) -> Log:
    return Log(
        f"ur10_{joint}",
        f"UR10, {joint}",
        _UR10,
        "real/raw/ur10.db3",
        "ur10",
        (
            f"import ur10.db3 --profile ur10.toml --joint {joint} --side output --map "
            f"torque_nm=effort "
            f"--map motor_angle_rad=position --map motor_velocity_rad_s=velocity --out {joint}.csv",
            f"diagnose {joint}.csv --profile ur10.toml",
        ),
    )


SETS = (
    _ur10("shoulder_pan_joint"),
    _ur10("wrist_2_joint"),
    _ur10("wrist_3_joint"),
    Log(
        "emps",
        "EMPS",
        f"MATLAB 5 file with the angle and the voltage of the current loop. {_EMPS}",
        "real/raw/emps.mat",
        "emps",
        (
            "import emps.mat --map time_s=t --map motor_angle_rad=qm*1000@zero "
            "--map torque_nm=vir*35.15065188 --velocity-from-angle 60 --out emps.csv",
            "diagnose emps.csv --profile emps.toml",
        ),
        notes=(
            "The factor is `gtau` of the file, which the listing of `hdbench import "
            "emps.mat` shows",
        ),
    ),
    Log(
        "emps_pulses",
        "EMPS with load pulses",
        f"{_EMPS} {_PREPARED}",
        "real/emps_pulses.csv.gz",
        "emps",
        ("diagnose emps_pulses.csv.gz --profile emps.toml",),
    ),
    Log(
        "cogging_1",
        "Cogging of a brushless motor, first record",
        f"Text with uneven time stamps. {_COGGING}",
        "real/raw/cogging_1.txt",
        "motor",
        (
            "import cogging_1.txt --map time_s=Time --map motor_angle_rad=Position@zero "
            "--map motor_velocity_rad_s=Velocity --map motor_current_a=Iq --torque-constant 2.5 "
            "--out cogging_1.csv",
            "diagnose cogging_1.csv --profile motor.toml",
        ),
    ),
    Log(
        "cogging_2",
        "Cogging of a brushless motor, second record",
        f"{_COGGING} {_PREPARED}",
        "real/cogging_2.csv.gz",
        "motor",
        ("diagnose cogging_2.csv.gz --profile motor.toml",),
    ),
    Log(
        "lara8",
        "LARA8, joint 3",
        "Text of a robot with harmonic drives: two encoders of 24 bit, torque of the "
        "motor current. "
        "allwinlucious/MasterThesis, BSD-3-Clause.",
        "lara8_dual_encoder/validate_joint3_sweep.csv",
        "lara8",
        (
            "import validate_joint3_sweep.csv --map time_s=Timestamp --map "
            "torque_nm=joint_torque_current_3 "
            "--map motor_velocity_rad_s=joint_velocity_3*101 "
            "--map motor_angle_rad=encoder_motorinc_3*3.745070282923929e-07@zero "
            "--map output_angle_rad=encoder_loadinc_3*3.745070282923929e-07@zero --out sweep.csv",
            "diagnose sweep.csv --profile lara8.toml --from-s 1.207 --to-s 6.164",
        ),
        keys={
            "drive.gear_ratio": 101.0,
            "drive.rated_torque_nm": 150.0,
            "limits.torque_nm": 300.0,
            "limits.velocity_rad_s": 1000.0,
        },
        notes=(
            "The part of the record in which the joint turns faster than 0.86 rad/s is looked at",
        ),
    ),
    Log(
        "kuka_med",
        "KUKA LBR Med",
        "Text without a time: angles and torques of seven joints. "
        "lbr-stack/dynamic_parameter_identification, MIT.",
        "real/raw/kuka_med.csv",
        "lbr",
        (
            "import kuka_med.csv",
            "import kuka_med.csv --profile lbr.toml --joint 0 --side output --rate 100 "
            "--map torque_nm=tau_0 --map motor_angle_rad=q_0 --velocity-from-angle 10 "
            "--out joint_0.csv",
        ),
        keys={"drive.gear_ratio": 100.0},
        notes=(
            "Rate and gear ratio are not published with the file: 100 Hz and 100 only "
            "show the way. Nothing that "
            "depends on speed could be trusted, so it is not diagnosed",
        ),
    ),
    Log(
        "xl330",
        "Servo XL330 with a pendulum",
        "JSON records at an uneven rate; `load` is a signed number stored without sign. "
        "Rhoban/bam, Apache-2.0.",
        "real/raw/xl330_pendulum.json",
        "xl330",
        (
            "import xl330_pendulum.json",
            "inspect xl330_pendulum.json",
            "import xl330_pendulum.json --map time_s=timestamp --map torque_nm=load*1@int16 "
            "--map motor_angle_rad=position --map motor_velocity_rad_s=speed "
            "--map torque_enable=torque_enable --out pendulum.csv",
        ),
        notes=(
            "Torque scale and inertia are not in the file, so the torque stands in "
            "counts of the servo and is not "
            "diagnosed. `torque_enable` is kept beside it: the drive is off where it is 0",
        ),
    ),
)
