"""Result of a calibration: gain, uncertainty, steps, and the record of how it was made."""

from __future__ import annotations

from typing import Annotated

from pydantic import PlainSerializer

from hdbench.records.loads import SequenceEntry
from hdbench.results.parts import Part, Result, Uncertain, key, listed, optional

_Entry = Annotated[SequenceEntry, PlainSerializer(SequenceEntry.to_dict)]


class LimitTest(Part):
    """One value against its limit."""

    name: str = key("what is held against a limit")
    value: float | None = key("found, at least 0; none where the data do not give it")
    limit: float = key("limit")
    upper: float | None = optional("upper end of the 95 % interval of the value")
    passed: bool | None = optional("whether it passed; none where it cannot be tested")


class Acceptance(Part):
    """Every limit that was tested, and the rule by which the tests decide."""

    decision_rule: str = key("rule by which the tests decide")
    statement: str = key("the outcome in words", default="")
    tests: tuple[LimitTest, ...] = listed("one entry per test")


class ExperimentLine(Part):
    """Torque on voltage for one loading experiment: ordinary least squares, with intercept."""

    id: str = key("name of the experiment in the loads file")
    position_rad: float = key("flexspline position", "rad")
    direction: str = key("cw or ccw")
    range: str = key("low or full")
    gain_nm_per_v: float = key("slope of torque on voltage", "N m/V")
    gain_std_nm_per_v: float | None = optional("standard uncertainty of the slope", "N m/V")
    gain_dof: float | None = optional("its degrees of freedom")
    intercept_nm: float = key("torque at 0 V", "N m")
    intercept_std_nm: float | None = optional("standard uncertainty of the intercept", "N m")
    zero_v: float | None = optional("reading at zero torque by the line", "V")
    residual_rms_nm: float = key("scatter about the line", "N m")
    hysteresis_nm: float | None = optional("largest difference of unloading and loading", "N m")
    n: int = key("readings")
    doubtful: tuple[int, ...] = listed(
        "places, in the loads file, of readings that stand off the line; they are kept"
    )


class ExperimentStep(Part):
    """Readings of one experiment under one applied torque."""

    experiment: str = key("experiment")
    torque_nm: float = key("load", "N m")
    reading_up_v: float | None = key("mean reading of loading", "V")
    reading_down_v: float | None = key("mean reading of unloading", "V")
    hysteresis_v: float | None = key("unloading less loading", "V")
    deviation_nm: float | None = key("deviation from the experiment's line", "N m")


class StepUncertainty(Part):
    """Relative uncertainty of one step in one case."""

    parts: dict[str, float] = key(
        "relative standard uncertainties by source: torque, resolution, repeatability, "
        "reproducibility, zero, and fit or reversibility; a source without data is left out"
    )
    relative_std: float | None = key("combined relative standard uncertainty")
    dof: float | None = key("its effective degrees of freedom")
    expanded_relative_k2: float | None = key("twice the relative standard uncertainty")
    expanded_relative_k2_with_deviation: float | None = key("the same with the deviation added")
    coverage_factor: float | None = key("factor for 95 % with these degrees of freedom")
    expanded_relative: float | None = key("relative expanded uncertainty with that factor")
    expanded_relative_with_deviation: float | None = key("the same with the deviation added")
    deviation_added: float | None = key("relative deviation that was added")
    expanded_nm_k2: float | None = key("twice the standard uncertainty", "N m")
    expanded_nm: float | None = key("expanded uncertainty", "N m")


class LoadStep(Part):
    """One load step of one group, in the manner of EURAMET cg-14."""

    direction: str = key("cw or ccw", default="")
    range: str = key("low or full", default="")
    loading: str = key("how the torque was applied", default="")
    arm_length_m: float | None = optional("arm that it was applied with", "m")
    torque_nm: float = key("applied torque", "N m")
    deflection_v: float | None = key("mean reading less the zero", "V")
    deflection_up_down_v: float | None = optional(
        "mean of loading and unloading less the zero", "V"
    )
    fitted_v: float | None = optional("deflection by the line through zero", "V")
    repeatability_v: float | None = optional("b', between series of one mounting", "V")
    reproducibility_v: float | None = optional("b, between mountings, standard deviation", "V")
    range_v: float | None = optional("between mountings, largest less smallest", "V")
    reversibility_v: float | None = optional("h, unloading less loading", "V")
    deviation_linear_v: float | None = optional("fa, deviation from the line through zero", "V")
    deviation_cubic_v: float | None = optional("deviation from the cubic", "V")
    repeatability_relative: float | None = optional("b' over the deflection")
    reproducibility_relative: float | None = optional("b over the deflection")
    range_relative: float | None = optional("range over the deflection")
    reversibility_relative: float | None = optional("h over the deflection")
    deviation_linear_relative: float | None = optional("fa over the deflection")
    deviation_cubic_relative: float | None = optional(
        "deviation from the cubic over the deflection"
    )
    deviation_up_down_relative: float | None = optional(
        "the same for loading and unloading together"
    )
    increasing: StepUncertainty | None = optional("uncertainty of the step, loading alone")
    increasing_decreasing: StepUncertainty | None = optional(
        "uncertainty of the step, loading and unloading"
    )


class Criterion(Part):
    """One criterion and the class that it allows."""

    name: str = key("criterion")
    value: float | None = key("found, relative; for resolution the smallest load over it")
    allowed: float | None = key("class that the value meets", name="class")
    limit: float | None = key("limit of that class")


class Classification(Part):
    """The class that all criteria allow."""

    value: float | None = key(
        "class by these series, per cent; none where a criterion is not met", name="class"
    )
    reason: str = key("what decides it")
    criteria: tuple[Criterion, ...] = listed("one entry per criterion")
    missing: tuple[str, ...] = listed("criteria that these data cannot decide")


class GroupSeries(Part):
    """One series of a group."""

    id: str = key("name of the experiment")
    position_rad: float = key("flexspline position", "rad")
    position: int = key("number of the mounting")
    repeat: int = key("number of the series in it")
    up_v: tuple[float | None, ...] = listed("deflections of loading", "V")
    down_v: tuple[float | None, ...] = listed(
        "deflections of unloading; none where there was no reading", "V"
    )
    zero_before_v: float | None = optional("reading before the first load", "V")
    zero_after_v: float | None = optional("reading after the last", "V")


class SeriesLackOfFit(Part):
    """What all series have in common about the straight lines through their zeros."""

    curve_v: tuple[float, ...] = key("what the curve adds to the line at each load", "V")
    relative: float = key("its largest value over the largest deflection")
    f_ratio: float | None = key("variance of the curve over that between mountings")
    probability: float | None = key("of such a ratio where there is no curve")
    dof: tuple[int, int] = key("degrees of freedom of both variances")
    pooled_f_ratio: float | None = key("the same over the pooled scatter")


class LoadGroup(Part):
    """Series of one direction, range and loading taken together."""

    direction: str = key("cw or ccw")
    range: str = key("low or full")
    loading: str = key("how the torque was applied", default="")
    arm_length_m: float | None = optional("arm that it was applied with", "m")
    n_positions: int = key("mountings")
    n_series: int = key("series of loading")
    n_series_up_down: int = key("of these with unloading", default=0)
    largest_torque_nm: float = key("largest load", "N m")
    sensitivity_v_per_nm: float | None = optional(
        "deflection at the largest load over that load", "V/(N m)"
    )
    gain_nm_per_v: float | None = optional("its inverse", "N m/V")
    gain_up_nm_per_v: float | None = optional("by the line through zero, loading alone", "N m/V")
    gain_up_down_nm_per_v: float | None = optional("the same, loading and unloading", "N m/V")
    linear_v_per_nm: float | None = optional(
        "slope of the line through zero, loading alone", "V/(N m)"
    )
    linear_up_down_v_per_nm: float | None = optional("the same, loading and unloading", "V/(N m)")
    cubic_v: tuple[float, ...] | None = optional(
        "coefficients of the cubic: V per N m, per (N m)^2, per (N m)^3"
    )
    zero_v: float | None = optional("largest change of the zero over a series", "V")
    zero_relative: float | None = optional("the same over the largest deflection")
    resolution_v: float | None = optional("resolution of the indication", "V")
    class_increasing: Classification | None = optional("class by loading alone")
    class_increasing_decreasing: Classification | None = optional("class by loading and unloading")
    zero_by_line: tuple[str, ...] = listed(
        "series whose zero was not read but taken from their line"
    )
    torque_nm: tuple[float, ...] = listed("loads", "N m")
    series: tuple[GroupSeries, ...] = listed("one entry per series")
    lack_of_fit: SeriesLackOfFit | None = optional("whether a curve fits better than a line")


class ExpandedGain(Part):
    """A gain with its expanded uncertainty."""

    value: float = key("gain", "N m/V")
    unit: str = key("its unit", default="N m/V")
    std: float = key("standard uncertainty", "N m/V")
    dof: float | None = key("effective degrees of freedom")
    coverage_factor: float = key("factor of the expanded uncertainty")
    coverage_probability: float = key("probability that it stands for", default=0.95)
    expanded: float = key("expanded uncertainty", "N m/V")
    expanded_relative: float | None = key("the same over the gain")


class GainUncertainty(Part):
    """Uncertainty of the gain in three senses."""

    mean_of_positions: ExpandedGain | None = key("gain as mean over mountings", "N m/V")
    any_one_position: ExpandedGain | None = key("gain in one mounting, whichever", "N m/V")
    naive: ExpandedGain | None = key("were all experiments independent", "N m/V")
    naive_reason: str = key(
        "why they are not",
        default="takes every experiment as independent, which those that share a position are "
        "not; for comparison only",
    )


class PositionVariance(Part):
    """One-way analysis of variance of gains with the position as random effect."""

    n_positions: int = key("mountings")
    n_experiments: int = key("experiments")
    replicates: float = key("experiments per mounting, mean for unequal numbers")
    mean_square_between: float = key("mean square between mountings", "(N m/V)^2")
    mean_square_within: float | None = key("mean square within a mounting", "(N m/V)^2")
    f_ratio: float | None = key("their ratio")
    probability: float | None = key("of such a ratio where mountings do not differ")
    repeatability_nm_per_v: float = key("standard deviation within a mounting", "N m/V")
    between_positions_nm_per_v: float = key("standard deviation between mountings", "N m/V")
    reproducibility_nm_per_v: float = key("of any one experiment", "N m/V")
    intraclass_correlation: float | None = key("share of the variance between mountings")
    mean_std_nm_per_v: float = key("standard uncertainty of the mean", "N m/V")
    mean_dof: int = key("its degrees of freedom")


class MixedModel(Part):
    """Gains with fixed effects of direction and range and a random effect of the position."""

    method: str = key(
        "how the model was fitted",
        default="restricted maximum likelihood, directions and ranges fixed, position random",
    )
    gain_nm_per_v: Uncertain = key("gain", "N m/V")
    between_positions_nm_per_v: float = key("between mountings", "N m/V")
    repeatability_nm_per_v: float = key("within a mounting", "N m/V")


class PairedDifference(Part):
    """Mean difference of pairs of gains that share all but one thing."""

    first: str = key("what the second is taken from")
    second: str = key("what is taken from the first")
    mean_first_nm_per_v: float = key("mean gain of the first", "N m/V")
    mean_second_nm_per_v: float = key("mean gain of the second", "N m/V")
    difference_nm_per_v: Uncertain = key("first less second", "N m/V")
    relative: Uncertain = key("the same over the gain")
    t_statistic: float | None = key("difference over its standard uncertainty")
    probability: float | None = key("of such a difference where there is none")
    n_pairs: int = key("pairs that were compared")


class DirectionEffects(Part):
    """What the difference of the directions is made of."""

    separated: bool = key("whether side force and asymmetry can be told apart")
    group: tuple[str, ...] = key("causes that cannot be told apart here")
    reason: str = key("why")
    crosstalk_v_per_n: Uncertain | None = optional("reading per side force", "V/N")
    half_asymmetry: Uncertain | None = optional("half the relative difference of cw and ccw")


class Consensus(Part):
    """Gains weighted by their own uncertainties."""

    birge_ratio: float = key("scatter over what the lines' own uncertainties explain")
    chi_square: float = key("sum of squared deviations over those uncertainties")
    between_std_nm_per_v: float = key("scatter that they do not explain", "N m/V")
    weighted_mean_nm_per_v: Uncertain = key("weighted mean of the gains", "N m/V")


class Loop(Part):
    """Unloading less loading of one experiment, in torque by its own gain."""

    largest_nm: float = key("largest difference of unloading and loading", "N m")
    at_torque_nm: float = key("load at which it is", "N m")
    relative: float = key("the same over the largest load")
    largest_torque_nm: float = key("largest load", "N m")
    area_v_nm: float = key("area of the loop", "V N m")
    area_relative: float = key("the same over largest load times largest deflection")
    zero_return_nm: float | None = key("zero after unloading less zero before", "N m")
    zero_return_relative: float | None = key("the same over the largest load")
    constant_nm: float | None = key("part of the difference that no load changes", "N m")
    lens_nm: float | None = key("part that is largest at half load", "N m")


class Outlier(Part):
    """A gain, the gains of a position, or a reading that stands off; flagged, never removed."""

    kind: str = key("gain, position or reading")
    experiment: str = key("experiment")
    position_rad: float | None = optional("flexspline position", "rad", absent=True)
    series: str | None = optional("up or down", absent=True)
    torque_nm: float | None = optional("load", "N m", absent=True)
    off_v: float | None = optional("distance from the line", "V", absent=True)
    statistic: float = key("distance in standard deviations")
    limit: float = key("beyond which it is an outlier")


class Correction(Part, kw_only=False):
    """One correction of the applied torque."""

    name: str = key("correction")
    relative: float = key("its relative size at the largest load; 0 where none was made")
    made: bool = key("whether it was made")
    detail: str = key("with which numbers, or what is not known")
    uncertainty_share: float | None = optional("its share of the torque's variance")


class BudgetRow(Part):
    """One source of uncertainty, relative to the gain."""

    name: str = key("source of uncertainty")
    group: str = key("what it belongs to")
    half_width: float | None = key(
        "half width or standard uncertainty that was declared, in `unit`"
    )
    unit: str = key("unit of the half width", default="1")
    distribution: str = key("distribution that it is taken for")
    divisor: float = key("half width over standard uncertainty", default=1.0)
    sensitivity: float = key("relative change per unit", default=1.0)
    relative_std: float = key("relative standard uncertainty that it contributes")
    dof: float | None = optional("degrees of freedom; none where they are taken as infinite")
    share: float | None = optional("share of the variance")
    declared: bool = key("whether it is known; what is not counts as nothing")
    origin: str = key("certificate or reason", default="not declared")


class AppliedTorqueAccount(Part):
    """Where the applied torques come from and what they are uncertain by."""

    source: str = key("how the applied torque is known")
    gravity_m_s2: float | None = key("local acceleration of gravity", "m/s^2")
    gravity_source: str = key("where it is from")
    gravity_over_standard: float | None = key("over 9.80665 m/s^2")
    largest_nm: float | None = key("largest applied torque, corrected", "N m")
    largest_nominal_nm: float | None = key("the same by mass, standard gravity and length", "N m")
    tilt_rad: float | None = key("largest tilt of the arm under load", "rad")
    corrections: tuple[Correction, ...] = listed("one entry per correction")
    relative_std: float | None = key("relative standard uncertainty of the applied torque")
    budget: tuple[BudgetRow, ...] = listed("contributions to it")
    not_declared: tuple[str, ...] = listed("sources without a declared uncertainty")


class SideForce(Part):
    """Force that a weight on a single arm puts on the flexspline beside its torque."""

    force_n: float | None = key("side force of a one-sided arm", "N")
    bending_nm: float | None = key("bending moment that it makes", "N m")
    half_direction_difference: float | None = key("half the relative difference of cw and ccw")
    cancels: bool = key("whether the mean over directions is free of it")
    reason: str = key("why")


class MonteCarlo(Part):
    """Gain by random draws."""

    draws: int = key("random draws")
    seed: int = key("seed of the random numbers")
    mean_nm_per_v: float = key("mean of the drawn gains", "N m/V")
    std_nm_per_v: float = key("their standard deviation", "N m/V")
    interval_nm_per_v: tuple[float, float] = key("symmetric 95 % interval", "N m/V")
    shortest_interval_nm_per_v: tuple[float, float] = key("shortest 95 % interval", "N m/V")
    expanded_nm_per_v: float = key("half of the symmetric interval", "N m/V")
    agrees_with_formula: bool = key("whether both ends agree within the tolerance")
    tolerance_nm_per_v: float = key("within which the ends should agree", "N m/V")


class Ends(Part):
    """First, last, smallest and largest of what was recorded with the readings."""

    first: float = key("at the first reading")
    last: float = key("at the last")
    least: float = key("smallest")
    largest: float = key("largest")


class Course(Part):
    """Environment and times of the readings."""

    temperature_c: Ends | None = optional("temperature", "degC")
    humidity_percent: Ends | None = optional("relative humidity", "%")
    pressure_hpa: Ends | None = optional("air pressure", "hPa")
    time_s: Ends | None = optional("time of the readings", "s")
    n_preloads: int = key("preloads that were recorded", default=0)
    n_excluded_samples: int = key("samples left out of the readings", default=0)
    excluded_at_s: tuple[float, ...] = listed("when they were", "s")


class ShuntRecord(Part):
    """Shunt readings against those of the last calibration."""

    resistor_ohm: float | None = optional("shunt resistor", "ohm")
    reading_v: float | None = optional("mean reading with the shunt", "V")
    n: int = key("shunt readings", default=0)
    expected_v: float | None = optional("reading at the last calibration", "V")
    change: float | None = optional("relative change since then")
    tolerance: float | None = optional("change that is accepted")
    within: bool | None = optional("whether it is within")
    torque_equivalent_nm: float | None = optional("torque that reads the same as the shunt", "N m")


class MassRecord(Part):
    """What was declared of the weights."""

    certificate: str = key("their certificate", default="")
    accuracy_class: str = key("their class", default="")
    relative_half_width: float | None = optional("relative half width of a mass")
    relative_correction: float | None = optional("certified less nominal, over nominal")
    density_kg_m3: float | None = optional("density of the weights", "kg/m^3")
    mass_kind: str = key("whether the masses are conventional or true", default="")


class LengthRecord(Part):
    """What was declared of the arm's length."""

    certificate: str = key("certificate of the length", default="")
    half_width_m: float | None = optional("half width of the length", "m")


class TorqueRecord(Part):
    """What was declared of a reference torque sensor."""

    certificate: str = key("its certificate", default="")
    identity: str = key("type and serial number", default="")
    relative_expanded_uncertainty: float | None = optional("relative, k = 2")


class InstrumentRecord(TorqueRecord):
    """What was declared of the instrument that reads the bridge."""

    resolution_v: float | None = optional("smallest step of its indication", "V")


class StandardsRecord(Part):
    """What the calibration is traceable to."""

    mass: MassRecord = key("weights", default=MassRecord())
    length: LengthRecord = key("length of the arm", default=LengthRecord())
    torque: TorqueRecord = key("reference torque sensor", default=TorqueRecord())
    instrument: InstrumentRecord = key(
        "instrument that reads the bridge", default=InstrumentRecord()
    )


class IdentityRecord(Part):
    """Who calibrated what, and where."""

    laboratory: str = key("who calibrated", default="")
    place: str = key("where", default="")
    customer: str = key("for whom", default="")
    operator: str = key("by whom", default="")
    drive_serial: str = key("serial number of the drive", default="")
    flexspline_serial: str = key("serial number of the flexspline", default="")
    bridge_ohm: float | None = optional("resistance of the bridge", "ohm")
    cable: str = key("cable to the bridge", default="")
    amplifier_serial: str = key("serial number of the amplifier", default="")
    excitation_v: float | None = optional("excitation of the bridge", "V")
    amplifier_gain: float | None = optional("gain of the amplifier")
    gauge_factor: float | None = optional("gauge factor")
    gear_ratio: float | None = optional("gear ratio of the drive")
    rated_torque_nm: float | None = optional("rated torque of the drive", "N m")


class ArmRecord(Part):
    """Arm of the profile."""

    length_m: float = key("distance of the weights from the axis", "m")
    latitude_deg: float | None = optional("latitude, for the gravity", "deg")
    altitude_m: float | None = optional("altitude, for the gravity", "m")
    gravity_formula: str | None = optional("formula of the local gravity")
    gravity_m_s2: float | None = optional("local gravity", "m/s^2")
    gravity_half_width_m_s2: float | None = optional("its half width", "m/s^2")
    thermal_expansion_per_k: float | None = optional("thermal expansion of the arm", "1/K")
    reference_temperature_c: float | None = optional(
        "temperature at which the length holds", "degC"
    )
    temperature_half_width_k: float | None = optional("half width of the arm's temperature", "K")
    tilt_rad: float | None = optional("tilt of the arm without load", "rad")
    tilt_half_width_rad: float | None = optional("its half width", "rad")
    torsional_stiffness_nm_per_rad: float | None = optional("of what the arm turns with", "N m/rad")
    lost_motion_rad: float | None = optional("play that the arm turns through", "rad")
    hang_offset_m: float | None = optional("hang point below the axis of the arm", "m")
    hang_offset_half_width_m: float | None = optional("its half width", "m")
    cant_half_width_rad: float | None = optional(
        "half width of the slope of the arm's plane", "rad"
    )
    tare_kg: float | None = optional("pan and hook", "kg")
    side_force_distance_m: float | None = optional("of the load from the sensor's plane", "m")
    air_density_kg_m3: float | None = optional("density of the air", "kg/m^3")
    air_density_half_width_kg_m3: float | None = optional("its half width", "kg/m^3")
    loading: str = key("one-sided or a pair of forces", default="")


class ReadingRecord(Part):
    """One reading."""

    experiment: str = key("experiment")
    series: str = key("up or down")
    kind: str = key("reading, preload or shunt", default="reading")
    torque_nm: float = key("load", "N m")
    mass_kg: float | None = optional("mass that made it", "kg")
    reading_v: float = key("mean reading", "V")
    reading_std_v: float | None = optional("scatter of its samples", "V")
    n_samples: int | None = optional("samples averaged")
    time_s: float | None = optional("when", "s")
    temperature_c: float | None = optional("temperature", "degC")
    settle_s: float | None = optional("time until it stood still", "s")
    slope_v_s: float | None = optional("drift while it was read", "V/s")
    flags: tuple[str, ...] = listed("what is doubtful about it")
    excluded_at_s: tuple[float, ...] = listed("samples left out of it", "s")


class CalibrationResult(Result):
    """What a set of loading experiments says about the torque gain."""

    schema: str = key("hdbench/KIND/1", default="hdbench/calibration/1")
    title: str = key("name of the result for a person", default="Calibration record")
    gain_nm_per_v: Uncertain = key("plain mean of the experiments' gains", "N m/V")
    gain_basis: str = key(
        "which scatter the standard uncertainty of the gain comes from", default=""
    )
    gain_basis_reason: str = key("why that one", default="")
    consistency: float | None = key("standard deviation over mean of the experiments' gains")
    consistency_interval: tuple[float, float] | None = optional(
        "its 95 % interval, lower and upper end"
    )
    consistency_interval_positions: tuple[float, float] | None = optional(
        "the same where positions, not experiments, are independent"
    )
    consistency_interval_vangel: tuple[float, float | None] | None = optional(
        "the same by Vangel's method"
    )
    max_consistency: float | None = optional("limit of the profile for the consistency")
    n_experiments: int = key("experiments, that is fitted lines")
    accepted: bool | None = key(
        "whether every test of the acceptance passed; none where one could not be tested and "
        "none failed"
    )
    acceptance: Acceptance | None = optional(
        "decision rule, statement and tests with value and limit"
    )
    experiments: tuple[ExperimentLine, ...] = key("one entry per fitted line")
    method: str = key("method of the metrological evaluation", default="")
    steps: tuple[LoadStep, ...] = listed(
        "load steps of the metrological evaluation, with the parts of their uncertainty"
    )
    grade: float | None = optional(
        "class of the sensor, per cent; none where a criterion is not met", name="class"
    )
    class_reason: str = key("what decides the class", default="")
    groups: tuple[LoadGroup, ...] = listed(
        "series of one direction, range and loading taken together"
    )
    uncertainty: GainUncertainty | None = optional(
        "of the gain: mean of positions, any one position, and naive"
    )
    positions: PositionVariance | None = optional(
        "analysis of variance between and within positions"
    )
    mixed_model: MixedModel | None = optional("gain with positions as a random effect")
    direction: PairedDifference | None = optional("difference between cw and ccw")
    direction_effects: DirectionEffects | None = optional(
        "what the difference of the directions is made of"
    )
    ranges: PairedDifference | None = optional("difference between low and full range")
    consensus: Consensus | None = optional("mean weighted by the experiments' own uncertainties")
    hysteresis: dict[str, Loop] = key(
        "of loading against unloading, by the name of the experiment", default={}
    )
    outliers: tuple[Outlier, ...] = listed("gains and readings that stand off")
    torque: AppliedTorqueAccount | None = optional(
        "what the applied torque's uncertainty is made of"
    )
    side_force: SideForce | None = optional("effect of the side force of an arm")
    budget: tuple[BudgetRow, ...] = listed("contributions to the uncertainty of the gain")
    experiment_steps: tuple[ExperimentStep, ...] = listed("steps of every experiment")
    monte_carlo: MonteCarlo | None = optional("the budget by random draws")
    course: Course = key("the readings over time", default=Course())
    shunt: ShuntRecord | None = optional("shunt calibration before and after")
    deviations: tuple[str, ...] = listed("how this calibration differs from the standard procedure")
    standards: StandardsRecord | None = optional("weights and length standards used")
    identity: IdentityRecord | None = optional("drive, sensor and amplifier")
    arm: ArmRecord | None = optional("arm of the profile")
    validity_days: float | None = optional("how long the calibration may be used", "d")
    average_s: float | None = optional("how long a reading was averaged", "s", absent=True)
    sequence: tuple[_Entry, ...] = listed("order of the steps")
    readings: tuple[ReadingRecord, ...] = listed("every reading")
