"""The report's bench and others like it."""

import pytest

from hdbench.gauges import LAYOUTS, GridGeometry, gauged_bench
from hdbench.gauges.strain import GaugedBench, StrainField, Wave
from hdbench.profile import load_profile
from hdbench.profile.schema import ProfileData


@pytest.fixture(scope="session")
def report() -> ProfileData:
    return load_profile("cim-tr-97-06").data


@pytest.fixture(scope="session")
def bench(report: ProfileData):
    def make(
        layout: str = "four", *, spacing: float = 0.0, normal: float = 0.0, **field: float
    ) -> GaugedBench:
        """Return the report's sensor with grids at one radius and shear waves only."""
        waves = (
            Wave(2.0, field.pop("second", report.sensor.wave_strain)),
            Wave(4.0, field.pop("fourth", 0.0)),
        )
        strain = StrainField(1.0, waves, normal_share=normal, **field)
        return gauged_bench(report, LAYOUTS[layout], GridGeometry(16.5, spacing), strain)

    return make
