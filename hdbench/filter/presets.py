"""Filter models by name: the report's, of stored results, of model files, of a run that had one."""

from __future__ import annotations

import difflib
import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError

from hdbench.errors import DataError
from hdbench.filter.model import SCHEMA, FilterModel, OscillatorBlock
from hdbench.profile import Profile
from hdbench.profile.schema import ProfileData
from hdbench.records.jsonfile import read_json
from hdbench.results import Part
from hdbench.results.parts import first_fault

_PREFIX = "results-on-"
_FEED = "evaluate that run again and feed its result.json"
MODEL_SCHEMA = "hdbench/model/1"
PRESETS = ("report-a1", "report-a2", "report-6")
_MOTOR_ORDERS = {"wave-generator-eccentricity": 1.0, "motor-unbalance": 1.0}
_OUTPUT_ORDERS = {"misalignment": 1.0, "angular-misalignment": 2.0, "load-gravity": 1.0}
# repeated impacts: the defect's order, twice and three times it; poles: currents, slots, windings
_HARMONICS = {"bearing-defect": (1, 2, 3), "cogging": (1, 2, 3, 6)}
_SOURCES = {
    "report-a1": "report CIM-TR-97-06, section 4 and listing A.1",
    "report-a2": "report CIM-TR-97-06, section 5 and listing A.2",
    "report-6": "report CIM-TR-97-06, section 5 (sixth-order model) with the noise of listing A.2",
}
# name of the filter that is tuned on the very input
TUNED = "tuned"


def _value_of(entry: object) -> object:
    """Return the value of an object with an uncertainty, or a number itself."""
    return entry.get("value") if isinstance(entry, Mapping) else entry


_Number = Annotated[float, BeforeValidator(_value_of)]
_Positive = Annotated[_Number, Field(gt=0.0)]


class _Noise(Part, strict=True):
    measurement_noise: _Positive | None = None
    process_noise: _Positive | None = None


class _Order(Part, strict=True):
    order: _Positive


class _Ripple(Part, strict=True):
    ripple: Annotated[list[_Order], Field(min_length=1)]
    filter: _Noise = _Noise()


class _Block(_Order, _Noise, strict=True):
    """The block that a misalignment adds."""


class _Misalignment(Part, strict=True):
    filter: _Block


class _Calibration(Part, strict=True):
    gain_nm_per_v: _Number


def build_filter_model(
    base: FilterModel,
    *,
    ripple: Mapping[str, Any] | None = None,
    misalignment: Mapping[str, Any] | None = None,
    calibration: Mapping[str, Any] | None = None,
) -> FilterModel:
    """Return a filter model with the numbers of stored results.

    Parameters
    ----------
    base : FilterModel
        Serves for every number that no result gives.
    ripple : mapping or None
        Result of a ripple run: the orders of ``ripple`` replace the ripple blocks; ``filter`` may
        give ``measurement_noise`` (R) and ``process_noise`` (Q of these blocks), (N m)^2.
    misalignment : mapping or None
        Result of a misalignment run: ``filter`` is the output-order block (``order`` and, else as
        in `base`, ``process_noise`` at ``measurement_noise``); it replaces the block of that
        order or joins the others.
    calibration : mapping or None
        Result of a calibration: ``gain_nm_per_v`` becomes the gain for traces in volts.

    Returns
    -------
    FilterModel
        `base` itself where no result is given; else turning with a measured angle where there is
        one. Its provenance names for each number the
        result, its run where it says so, and the SHA-256 of the result.

    Raises
    ------
    DataError
        If a result lacks what it should give, or gives a number out of its domain.

    Notes
    -----
    A new R scales every Q that no result gives by the same factor: the filter's gain depends on
    Q/R alone, so those blocks stay as selective as in `base`. A tuned base keeps all its noise:
    results give it orders only, with the noise of its own block of that kind.
    """
    if ripple is None and misalignment is None and calibration is None:
        return base
    blocks, tuned = base.blocks, base.order_prior_std_nm is not None
    provenance = dict(base.provenance)
    r, gain = base.measurement_noise, base.torque_gain_nm_per_v
    if misalignment is not None:
        block = _Misalignment.from_json(misalignment, "misalignment result", _FEED).filter
        added = _with_misalignment(blocks, block, r)
        blocks = _own_noise(blocks, added) if tuned else added
        provenance["misalignment block"] = _origin(misalignment, "misalignment")
    if ripple is not None:
        added, new_r = _with_ripple(blocks, _Ripple.from_json(ripple, "ripple result", _FEED), r)
        blocks, r = (_own_noise(blocks, added), r) if tuned else (added, new_r)
        provenance["ripple blocks, measurement_noise"] = _origin(ripple, "ripple")
    if calibration is not None:
        gain = _Calibration.from_json(calibration, "calibration result", _FEED).gain_nm_per_v
        provenance["torque_gain_nm_per_v"] = _origin(calibration, "calibration")
    try:
        return replace(
            base,
            name=base.name if base.name.startswith(_PREFIX) else _PREFIX + base.name,
            blocks=blocks,
            measurement_noise=r,
            use_measured_angle=True,
            provenance=provenance,
            torque_gain_nm_per_v=gain,
        )
    except ValidationError as error:
        raise DataError(first_fault(error)[1], where="stored results", fix=_FEED) from error


def _origin(result: Mapping[str, Any], kind: str) -> str:
    text = json.dumps(result, sort_keys=True, separators=(",", ":"), default=str)
    digest = hashlib.sha256(text.encode()).hexdigest()
    run = next((str(result[key]) for key in ("run", "run_id", "source") if result.get(key)), None)
    return f"{kind} result{f' of {run}' if run else ''}, sha256 {digest}"


def _own_noise(
    before: tuple[OscillatorBlock, ...], after: tuple[OscillatorBlock, ...]
) -> tuple[OscillatorBlock, ...]:
    """Return `after` with the tuned noise: of the same order, else of the first of its role."""
    found = []
    for block in after:
        like = [b for b in before if b.role == block.role] or list(before)
        # relative rounding of 1/N written and read again
        same = [b for b in like if abs(b.order - block.order) <= 1e-9 * block.order]
        template = (same or like)[0]
        found.append(
            replace(block, process_noise=template.process_noise, noise_per=template.noise_per)
        )
    return tuple(found)


def _with_ripple(
    blocks: tuple[OscillatorBlock, ...], result: _Ripple, r: float
) -> tuple[tuple[OscillatorBlock, ...], float]:
    """Return blocks and R after a ripple result; `r` is R before it."""
    new_r = r if result.filter.measurement_noise is None else result.filter.measurement_noise
    scaled = tuple(replace(b, process_noise=b.process_noise * new_r / r) for b in blocks)
    q = result.filter.process_noise
    if q is None:
        q = next((block for block in scaled if block.role == "ripple"), scaled[0]).process_noise
    found = tuple(OscillatorBlock(entry.order, "ripple", q) for entry in result.ripple)
    kept = tuple(block for block in scaled if block.role != "ripple" or block.frequency_hz > 0.0)
    return found + kept, new_r


def _with_misalignment(
    blocks: tuple[OscillatorBlock, ...], added: _Block, r: float
) -> tuple[OscillatorBlock, ...]:
    """Return the blocks after a misalignment result, its Q brought to the scale of `r`."""
    template = next((block for block in blocks if block.role == "misalignment"), blocks[-1])
    q = template.process_noise
    if added.process_noise is not None:
        q = added.process_noise
        if added.measurement_noise is not None:
            q *= r / added.measurement_noise
    block = OscillatorBlock(added.order, "misalignment", q)
    # relative rounding of 1/N written and read again
    kept = tuple(b for b in blocks if abs(b.order - block.order) > 1e-9 * block.order)
    return (*kept, block)


def preset(name: str, profile: ProfileData) -> FilterModel:
    """Return one of the report's filter models on the bench of `profile`.

    Parameters
    ----------
    name : str
        ``report-a1`` (orders 2 and 4), ``report-a2`` (2 and 1/N) or ``report-6`` (2, 4 and 1/N).
    profile : ProfileData
        Gear ratio, load inertia and the noise values in table ``filter``.

    Returns
    -------
    FilterModel
        Turning with the velocity, as in the report.

    Raises
    ------
    DataError
        If there is no such preset; names the nearest one.
    """
    if name not in PRESETS:
        raise _unknown(name)
    noise, ratio = profile.filter, profile.drive.gear_ratio
    orders = {"report-a1": (2.0, 4.0), "report-a2": (2.0,), "report-6": (2.0, 4.0)}[name]
    blocks = [OscillatorBlock(order, "ripple", noise.ripple_process_noise) for order in orders]
    if name != "report-a1":
        blocks.append(
            OscillatorBlock(1.0 / ratio, "misalignment", noise.misalignment_process_noise)
        )
    table = f"profile {profile.name}"
    return FilterModel(
        name=name,
        blocks=tuple(blocks),
        measurement_noise=noise.measurement_noise,
        load_inertia_kg_m2=profile.drive.load_inertia_kg_m2,
        gear_ratio=ratio,
        differentiator_time_constant_s=noise.differentiator_time_constant_s,
        use_measured_angle=False,
        provenance={
            "orders": _SOURCES[name],
            "noise": f"{table}, table filter",
            "expected torque": f"{table}, tables drive and filter",
        },
    )


def load_filter_model(name_or_path: str, profile: ProfileData) -> FilterModel:
    """Return a preset, or the model stored in a JSON file.

    Parameters
    ----------
    name_or_path : str
        A preset; a file of schema ``hdbench/filter-model/1``; or an extended bench model of schema
        ``hdbench/model/1``, whose order-locked causes become blocks beside those of ``report-6``.
    profile : ProfileData
        The bench; its numbers serve where the file has none.

    Returns
    -------
    FilterModel
        The model.

    Raises
    ------
    DataError
        If it is neither a preset nor a readable model file; names the nearest preset.
    """
    if name_or_path in PRESETS:
        return preset(name_or_path, profile)
    path = Path(name_or_path)
    if not path.is_file():
        raise _unknown(name_or_path)
    body = read_json(path)
    if body.get("schema") == SCHEMA:
        return FilterModel.from_dict(body, source=str(path))
    if body.get("schema") == MODEL_SCHEMA:
        return _from_bench_model(body, path, profile)
    raise DataError(
        f"schema is {body.get('schema')!r}; needed: {SCHEMA} or {MODEL_SCHEMA}",
        where=f"{path}:schema",
        fix="give the file that `hdbench tune --out` or `hdbench diagnose` wrote",
    )


def _unknown(name: str) -> DataError:
    if name == TUNED:
        return DataError(
            "'tuned' is tuned on the very input, and there is none before measuring; presets: "
            f"{', '.join(PRESETS)}",
            where="filter model",
            fix="tune on a stored run: `hdbench tune RUN --out tuned.json`, then name that file; "
            "or take `report-6`",
        )
    nearest = difflib.get_close_matches(name, PRESETS, n=1)
    return DataError(
        f"{name!r} is no filter model; presets: {', '.join(PRESETS)}, and there is no such file",
        where="filter model",
        fix=(f"did you mean `{nearest[0]}`? Or give" if nearest else "give")
        + " the path of a model file",
    )


# cycles per motor turn, or Hz
_Place = Annotated[float, BeforeValidator(_value_of), Field(gt=0.0, lt=1e6)]


class _Parameters(Part, strict=True):
    order: _Place | None = None
    frequency_hz: _Place | None = None


class _Cause(Part, strict=True):
    name: str
    parameters: _Parameters = _Parameters()

    def __post_init__(self) -> None:
        if self.name == "mains-hum" and self.parameters.frequency_hz is None:
            raise ValueError("key 'parameters.frequency_hz' is missing; needed: a number in Hz")


class _Component(Part, strict=True):
    order: _Place


class _Baseline(Part, strict=True):
    ripple: list[_Component] = Field(default_factory=list)


class _BenchModel(Part, strict=True):
    baseline: _Baseline = _Baseline()
    causes: list[_Cause] = Field(default_factory=list)


def _from_bench_model(body: dict[str, Any], path: Path, profile: ProfileData) -> FilterModel:
    base, noise = preset("report-6", profile), profile.filter.ripple_process_noise
    fix = "give the model file that `hdbench diagnose` wrote"
    stored = _BenchModel.from_json(body, str(path), fix)
    provenance = dict(base.provenance)
    blocks = [block for block in base.blocks if block.role == "misalignment"]
    # orders of the model's own ripple; those of the preset where the file names none
    own = [entry.order for entry in stored.baseline.ripple]
    orders = own or [block.order for block in base.blocks if block.role == "ripple"]
    found = [
        (f"ripple order {order:g}", f"{path}, baseline", OscillatorBlock(order, "ripple", noise))
        for order in orders
    ]
    for cause in stored.causes:
        of_cause = _cause_blocks(cause, profile)
        if not of_cause:
            provenance[f"cause {cause.name}"] = f"{path}: not locked to one order, no block"
        for block in of_cause:
            place = f"{block.frequency_hz:g} Hz" if block.frequency_hz else f"order {block.order:g}"
            found.append((place, f"{path}, cause {cause.name}", block))
    for what, source, block in found:
        if not any(_same_place(block, other) for other in blocks):
            blocks.append(block)
            provenance[what] = source
    try:
        return replace(
            base,
            name=path.stem,
            blocks=tuple(blocks),
            use_measured_angle=True,
            provenance=provenance,
        )
    except ValidationError as error:
        raise DataError(
            first_fault(error)[1], where=f"{path}:causes", fix="keep fewer causes in the model file"
        ) from error


def _same_place(a: OscillatorBlock, b: OscillatorBlock) -> bool:
    if a.frequency_hz or b.frequency_hz:
        # two tones closer than this cannot be parted within a hundred seconds
        return a.order == b.order and abs(a.frequency_hz - b.frequency_hz) < 1e-2
    # two orders closer than this cannot be parted within a thousand turns of the motor
    return abs(a.order - b.order) < 1e-3 * min(1.0, a.order, b.order)


def _cause_blocks(cause: _Cause, profile: ProfileData) -> list[OscillatorBlock]:
    """Return the blocks of a cause; none where its torque is not locked to single orders."""
    noise = profile.filter.ripple_process_noise
    if cause.name in _OUTPUT_ORDERS:
        order = _OUTPUT_ORDERS[cause.name] / profile.drive.gear_ratio
        return [OscillatorBlock(order, "misalignment", profile.filter.misalignment_process_noise)]
    hz = cause.parameters.frequency_hz
    if cause.name == "mains-hum" and hz is not None:
        # picked up by the sensor's wires: no torque
        return [OscillatorBlock(0.0, "ripple", noise, frequency_hz=hz)]
    turning = cause.parameters.order or _MOTOR_ORDERS.get(cause.name)
    if turning is None:
        return []
    return [OscillatorBlock(k * turning, "ripple", noise) for k in _HARMONICS.get(cause.name, (1,))]


def choose_filter(
    profile: Profile,
    name: str | None,
    *,
    misalignment: Path | None = None,
    source: Path | None = None,
) -> FilterModel:
    """Return the filter that was asked for."""
    stored = None if name or source is None else _stored_filter(source, profile)
    base = stored or load_filter_model(name or profile.data.filter.model, profile.data)
    if misalignment is None:
        return base
    file = misalignment / "result.json" if misalignment.is_dir() else misalignment
    result = read_json(file, "hdbench/misalignment/1")
    return build_filter_model(base, misalignment=result)


def _stored_filter(source: Path, profile: Profile) -> FilterModel | None:
    """Return the filter that ran while a run was sampled."""
    manifest = source / "run.json"
    if not manifest.is_file():
        return None
    body = read_json(manifest)
    own, model = body.get("profile"), body.get("filter")
    if not (isinstance(own, dict) and own.get("sha256") == profile.sha256):
        return None
    if not isinstance(model, dict):
        return None
    return FilterModel.from_dict(model, source=f"{manifest}: filter")
