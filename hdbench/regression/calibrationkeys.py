"""Keys inside the tables and lists of a calibration result, with type, unit and meaning."""

from __future__ import annotations

__all__ = ["CALIBRATION_PARTS"]

# one evaluation of a step, of loading alone and of loading and unloading
_STEP_PARTS = """
parts | table | | relative standard uncertainties by source: torque, reproducibility, zero, others
parts.torque | number | | of the applied torque
parts.reproducibility | number | | between mountings
parts.zero | number | | of the zero
parts.resolution | number or absent | | of the indication's resolution
relative_std | number or null | | combined relative standard uncertainty
dof | number or null | | its effective degrees of freedom
expanded_relative_k2 | number or null | | twice the relative standard uncertainty
expanded_relative_k2_with_deviation | number or null | | the same with the deviation added
coverage_factor | number or null | | factor for 95 % with these degrees of freedom
expanded_relative | number or null | | relative expanded uncertainty with that factor
expanded_relative_with_deviation | number or null | | the same with the deviation added
deviation_added | number or null | | relative deviation that was added
expanded_nm_k2 | number or null | N m | twice the standard uncertainty
expanded_nm | number or null | N m | expanded uncertainty
"""
_CLASS = """
class | number or null | | class by these series, per cent; none where a criterion is not met
reason | text | | what decides it
criteria | list | | one entry per criterion
criteria[].name | text | | criterion
criteria[].value | number or null | | found, relative
criteria[].class | number or null | | class that the value meets
criteria[].limit | number or null | | limit of that class
missing | list | | criteria that these data cannot decide
"""
_ESTIMATE = """
value | number | N m/V | gain
unit | text | | its unit
std | number | N m/V | standard uncertainty
dof | number or null | | effective degrees of freedom
coverage_factor | number | | factor of the expanded uncertainty
coverage_probability | number | | probability that it stands for
expanded | number | N m/V | expanded uncertainty
expanded_relative | number | | the same over the gain
"""
_DIFFERENCE = """
first | text | | what the second is taken from
second | text | | what is taken from the first
mean_first_nm_per_v | number | N m/V | mean gain of the first
mean_second_nm_per_v | number | N m/V | mean gain of the second
difference_nm_per_v | uncertain | N m/V | first less second
relative | uncertain | | the same over the gain
t_statistic | number or null | | difference over its standard uncertainty
probability | number or null | | of such a difference where there is none
n_pairs | integer | | pairs that were compared
"""
_CONTRIBUTION = """
name | text | | source of uncertainty
group | text | | what it belongs to
half_width | number or null | | half width or standard uncertainty that was declared, in `unit`
unit | text | | unit of the half width
distribution | text | | distribution that it is taken for
divisor | number or null | | half width over standard uncertainty
sensitivity | number or null | | relative change per unit
relative_std | number | | relative standard uncertainty that it contributes
dof | number or null | | degrees of freedom; none where they are taken as infinite
share | number or null | | share of the variance
declared | true or false | | whether it is known; what is not counts as nothing
origin | text | | certificate or reason
"""
_WHOLE = """
acceptance.decision_rule | text | | rule by which the tests decide
acceptance.statement | text | | the outcome in words
acceptance.tests | list | | one entry per test
acceptance.tests[].name | text | | what is held against a limit
acceptance.tests[].value | number | | found
acceptance.tests[].limit | number | | limit
acceptance.tests[].upper | number or null | | upper end of the 95 % interval of the value
acceptance.tests[].passed | true or false | | whether it passed
experiments[].gain_std_nm_per_v | number | N m/V | standard uncertainty of the slope
experiments[].gain_dof | number | | its degrees of freedom
experiments[].intercept_std_nm | number | N m | standard uncertainty of the intercept
experiments[].zero_v | number or null | V | mean reading without load
experiments[].hysteresis_nm | number or null | N m | largest difference of unloading and loading
experiments[].doubtful | list | | why its readings are doubtful
steps[].direction | text | | cw or ccw
steps[].range | text | | low or full
steps[].loading | text | | how the torque was applied
steps[].arm_length_m | number or null | m | arm that it was applied with
steps[].deflection_up_down_v | number or null | V | mean of loading and unloading less the zero
steps[].fitted_v | number | V | deflection by the cubic
steps[].repeatability_v | number or null | V | b', between series of one mounting
steps[].reproducibility_v | number or null | V | b, between mountings, standard deviation
steps[].range_v | number or null | V | between mountings, largest less smallest
steps[].reversibility_v | number or null | V | h, unloading less loading
steps[].deviation_linear_v | number | V | fa, deviation from the line through zero
steps[].deviation_cubic_v | number or null | V | deviation from the cubic
steps[].repeatability_relative | number or null | | b' over the deflection
steps[].reproducibility_relative | number or null | | b over the deflection
steps[].range_relative | number or null | | range over the deflection
steps[].reversibility_relative | number or null | | h over the deflection
steps[].deviation_linear_relative | number | | fa over the deflection
steps[].deviation_cubic_relative | number or null | | deviation from the cubic over the deflection
steps[].deviation_up_down_relative | number or null | | the same for loading and unloading together
steps[].increasing | table | | uncertainty of the step, loading alone
steps[].increasing.parts.fit | number | | of the fitted cubic
steps[].increasing_decreasing | table or null | | uncertainty of the step, loading and unloading
steps[].increasing_decreasing.parts.reversibility | number | | of the reversibility
groups[].direction | text | | cw or ccw
groups[].range | text | | low or full
groups[].loading | text | | how the torque was applied
groups[].arm_length_m | number or null | m | arm that it was applied with
groups[].n_positions | integer | | mountings
groups[].n_series | integer | | series of loading
groups[].n_series_up_down | integer | | of these with unloading
groups[].largest_torque_nm | number | N m | largest load
groups[].sensitivity_v_per_nm | number | V/(N m) | deflection at the largest load over that load
groups[].gain_nm_per_v | number | N m/V | its inverse
groups[].gain_up_nm_per_v | number | N m/V | by the line through zero, loading alone
groups[].gain_up_down_nm_per_v | number or null | N m/V | the same, loading and unloading
groups[].linear_v_per_nm | number | V/(N m) | slope of the line through zero, loading alone
groups[].linear_up_down_v_per_nm | number or null | V/(N m) | the same, loading and unloading
groups[].cubic_v | list | | coefficients of the cubic: V per N m, per (N m)^2, per (N m)^3
groups[].zero_v | number or null | V | largest change of the zero over a series
groups[].zero_relative | number or null | | the same over the largest deflection
groups[].resolution_v | number or null | V | resolution of the indication
groups[].class_increasing | table | | class by loading alone
groups[].class_increasing_decreasing | table | | class by loading and unloading
groups[].zero_by_line | list | | series whose zero was not read but taken from their line
groups[].torque_nm | list | N m | loads
groups[].series | list | | one entry per series
groups[].series[].id | text | | name of the experiment
groups[].series[].position_rad | number | rad | flexspline position
groups[].series[].position | integer | | number of the mounting
groups[].series[].repeat | integer | | number of the series in it
groups[].series[].up_v | list | V | deflections of loading
groups[].series[].down_v | list | V | deflections of unloading; empty where there was none
groups[].series[].zero_before_v | number or null | V | reading before the first load
groups[].series[].zero_after_v | number or null | V | reading after the last
groups[].lack_of_fit | table or null | | whether a curve fits better than a line
groups[].lack_of_fit.curve_v | list | V | what the curve adds to the line at each load
groups[].lack_of_fit.relative | number | | its largest value over the largest deflection
groups[].lack_of_fit.f_ratio | number or null | | variance of the curve over that between mountings
groups[].lack_of_fit.probability | number or null | | of such a ratio where there is no curve
groups[].lack_of_fit.dof | list | | degrees of freedom of both variances
groups[].lack_of_fit.pooled_f_ratio | number or null | | the same over the pooled scatter
uncertainty.mean_of_positions | uncertain | N m/V | gain as mean over mountings
uncertainty.any_one_position | uncertain | N m/V | gain in one mounting, whichever
uncertainty.naive | uncertain | N m/V | were all experiments independent
uncertainty.naive_reason | text | | why they are not
positions.n_positions | integer | | mountings
positions.n_experiments | integer | | experiments
positions.replicates | number | | experiments per mounting, mean for unequal numbers
positions.mean_square_between | number | (N m/V)^2 | mean square between mountings
positions.mean_square_within | number or null | (N m/V)^2 | mean square within a mounting
positions.f_ratio | number or null | | their ratio
positions.probability | number or null | | of such a ratio where mountings do not differ
positions.repeatability_nm_per_v | number or null | N m/V | standard deviation within a mounting
positions.between_positions_nm_per_v | number or null | N m/V | standard deviation between mountings
positions.reproducibility_nm_per_v | number or null | N m/V | of any one experiment
positions.intraclass_correlation | number or null | | share of the variance between mountings
positions.mean_std_nm_per_v | number | N m/V | standard uncertainty of the mean
positions.mean_dof | number | | its degrees of freedom
mixed_model.method | text | | how the model was fitted
mixed_model.gain_nm_per_v | uncertain | N m/V | gain
mixed_model.between_positions_nm_per_v | number or null | N m/V | between mountings
mixed_model.repeatability_nm_per_v | number or null | N m/V | within a mounting
direction_effects.separated | true or false | | whether side force and asymmetry can be told apart
direction_effects.group | list | | causes that cannot be told apart here
direction_effects.reason | text | | why
direction_effects.crosstalk_v_per_n | uncertain or null | V/N | reading per side force
direction_effects.half_asymmetry | uncertain or null | | half the relative difference of cw and ccw
consensus.birge_ratio | number or null | | scatter over what the lines' own uncertainties explain
consensus.chi_square | number or null | | sum of squared deviations over those uncertainties
consensus.between_std_nm_per_v | number or null | N m/V | scatter that they do not explain
consensus.weighted_mean_nm_per_v | uncertain or null | N m/V | weighted mean of the gains
outliers[].kind | text | | gain or reading
outliers[].experiment | text | | experiment
outliers[].position_rad | number or absent | rad | flexspline position
outliers[].series | text or absent | | up or down
outliers[].torque_nm | number or absent | N m | load
outliers[].off_v | number or absent | V | distance from the line
outliers[].statistic | number | | distance in standard deviations
outliers[].limit | number | | beyond which it is an outlier
"""


def _under(prefix: str, table: str) -> str:
    return "\n".join(f"{prefix}.{line}" for line in table.strip().splitlines())


CALIBRATION_PARTS = "\n".join(
    (
        _WHOLE.strip(),
        *(
            _under(f"steps[].{name}", _STEP_PARTS)
            for name in ("increasing", "increasing_decreasing")
        ),
        *(
            _under(f"groups[].{name}", _CLASS)
            for name in ("class_increasing", "class_increasing_decreasing")
        ),
        *(
            _under(f"uncertainty.{name}", _ESTIMATE)
            for name in ("mean_of_positions", "any_one_position", "naive")
        ),
        *(_under(name, _DIFFERENCE) for name in ("direction", "ranges")),
        *(_under(name, _CONTRIBUTION) for name in ("budget[]", "torque.budget[]")),
    )
)
"""Lines of ``key | type | unit | meaning`` of the evaluation's parts."""
