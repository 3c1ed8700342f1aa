"""The filter over stored traces: which channel serves as what."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from filter_oracle import motion
from numpy.testing import assert_allclose, assert_array_equal

from hdbench.errors import DataError
from hdbench.filter import OnlineFilter, filter_trace, filtered_columns, preset
from hdbench.records import Trace

GAIN = 56.2565


def trace(**columns):
    t, v, y, _ = motion(300)
    return Trace({"time_s": t, "torque_nm": y, "motor_velocity_rad_s": v, **columns}, "here.csv")


def test_a_stored_trace_gives_the_bits_of_the_online_filter(bench):
    model = preset("report-6", bench)
    stored = trace()
    online = OnlineFilter(model)
    parts = [
        online.process(
            stored.time_s[a:b], stored["motor_velocity_rad_s"][a:b], stored["torque_nm"][a:b]
        )
        for a, b in ((0, 17), (17, 200), (200, 300))
    ]
    whole = filter_trace(stored, model, velocity_gain_rad_s_per_v=GAIN)
    assert_array_equal(
        np.concatenate([part.torque_filtered_nm for part in parts]), whole.torque_filtered_nm
    )


def test_the_tacho_serves_where_there_is_no_velocity(bench):
    model = preset("report-6", bench)
    stored = trace()
    columns = dict(stored.columns)
    columns["tacho_v"] = columns.pop("motor_velocity_rad_s") / GAIN
    found = filter_trace(Trace(columns), model, velocity_gain_rad_s_per_v=GAIN)
    wanted = filter_trace(stored, model, velocity_gain_rad_s_per_v=GAIN)
    # one division and one product of rounding in the velocity
    assert_allclose(found.torque_filtered_nm, wanted.torque_filtered_nm, rtol=0.0, atol=1e-9)


def test_angle_or_encoder_serves_where_the_model_asks_for_it(bench):
    model = dataclasses.replace(preset("report-6", bench), use_measured_angle=True)
    count = np.round(np.linspace(0.0, 9000.0, 300))
    angle = count * (2.0 * np.pi / 4000)
    by_angle = filter_trace(trace(motor_angle_rad=angle), model, velocity_gain_rad_s_per_v=GAIN)
    by_count = filter_trace(
        trace(encoder_count=count),
        model,
        velocity_gain_rad_s_per_v=GAIN,
        encoder_counts_per_turn=4000,
    )
    by_velocity = filter_trace(trace(), model, velocity_gain_rad_s_per_v=GAIN)
    assert_array_equal(by_angle.torque_filtered_nm, by_count.torque_filtered_nm)
    assert np.abs(by_angle.torque_filtered_nm - by_velocity.torque_filtered_nm).max() > 1e-3


@pytest.mark.parametrize("name", ["torque_nm", "motor_velocity_rad_s"])
def test_a_missing_channel_is_named(bench, name):
    columns = dict(trace().columns)
    del columns[name]
    with pytest.raises(DataError, match=name) as caught:
        filter_trace(
            Trace(columns, "here.csv"), preset("report-6", bench), velocity_gain_rad_s_per_v=GAIN
        )
    assert "here.csv" in caught.value.where


def test_a_time_that_steps_back_names_file_and_sample(bench):
    stored = trace()
    stored.time_s[100] = stored.time_s[99]
    with pytest.raises(DataError) as caught:
        filter_trace(stored, preset("report-6", bench), velocity_gain_rad_s_per_v=GAIN)
    assert "here.csv" in caught.value.where
    assert "sample 100" in caught.value.where


def test_the_written_columns_are_the_contracts_and_add_up(bench):
    stored = trace()
    block = filter_trace(stored, preset("report-6", bench), velocity_gain_rad_s_per_v=GAIN)
    written = filtered_columns(stored, block)
    assert list(written.columns) == [
        "time_s",
        "torque_nm",
        "torque_expected_nm",
        "ripple_nm",
        "misalignment_nm",
        "torque_filtered_nm",
    ]
    assert_array_equal(
        written["torque_nm"] - (written["ripple_nm"] + written["misalignment_nm"]),
        written["torque_filtered_nm"],
    )
