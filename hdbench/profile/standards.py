"""The profile's tables of what a calibration is traceable to, and of who calibrates what."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from hdbench.profile.tables import NonNegative, Positive, Table

__all__ = [
    "Identity",
    "InstrumentStandard",
    "LengthStandard",
    "MassStandard",
    "Standards",
    "TorqueStandard",
]

_Share = Annotated[float, Field(ge=0.0, lt=1.0)]
_Text = Annotated[str, Field(max_length=200)]


class MassStandard(Table):
    """Weights: what their certificate states. Blank: not declared."""

    certificate: Annotated[_Text, Field(description="number of the certificate")] = ""
    accuracy_class: Annotated[
        Literal["", "E2", "F1", "F2", "M1", "M2", "M3"],
        Field(description="class of OIML R111; its limits serve where none are given"),
    ] = ""
    relative_half_width: Annotated[
        _Share | None, Field(description="limits +- of a mass, share of the mass")
    ] = None
    relative_correction: Annotated[
        float, Field(gt=-0.1, lt=0.1, description="conventional mass over nominal mass, less 1")
    ] = 0.0
    density_kg_m3: Annotated[
        float, Field(ge=1000.0, le=22000.0, description="density of the weights, kg/m^3")
    ] = 7850.0
    mass_kind: Annotated[
        Literal["conventional", "true"], Field(description="which mass the certificate states")
    ] = "conventional"


class LengthStandard(Table):
    """How the arm's length was measured. Blank: not declared."""

    certificate: Annotated[_Text, Field(description="number of the certificate")] = ""
    half_width_m: Annotated[
        NonNegative | None, Field(description="limits +- of the arm's length, m")
    ] = None


class TorqueStandard(Table):
    """Reference sensor, where torques are given and not made of weights. Blank: not declared."""

    certificate: Annotated[_Text, Field(description="number of the certificate")] = ""
    identity: Annotated[_Text, Field(description="maker, type, serial number")] = ""
    relative_expanded_uncertainty: Annotated[
        _Share | None, Field(description="U (k = 2) of an applied torque, share of the torque")
    ] = None


class InstrumentStandard(Table):
    """Voltmeter or DAQ that read the bridge. Blank: not declared."""

    certificate: Annotated[_Text, Field(description="number of the certificate")] = ""
    identity: Annotated[_Text, Field(description="maker, type, serial number")] = ""
    relative_expanded_uncertainty: Annotated[
        _Share | None, Field(description="U (k = 2) of a reading, share of the reading")
    ] = None
    resolution_v: Annotated[
        Positive | None, Field(description="smallest step, V; else from daq range and bits")
    ] = None


class Standards(Table):
    """What the calibration is traceable to, as the operator declares it."""

    mass: MassStandard = MassStandard()
    length: LengthStandard = LengthStandard()
    torque: TorqueStandard = TorqueStandard()
    instrument: InstrumentStandard = InstrumentStandard()


class Identity(Table):
    """Who calibrates what, and where. Blank: not declared."""

    laboratory: Annotated[_Text, Field(description="who calibrates, with address")] = ""
    place: Annotated[_Text, Field(description="where the calibration is made")] = ""
    customer: Annotated[_Text, Field(description="for whom")] = ""
    operator: Annotated[_Text, Field(description="who hangs the weights")] = ""
    drive_serial: Annotated[_Text, Field(description="type and serial number of the drive")] = ""
    flexspline_serial: Annotated[_Text, Field(description="serial number of the flexspline")] = ""
    bridge_ohm: Annotated[Positive | None, Field(description="resistance of the bridge, ohm")] = (
        None
    )
    cable: Annotated[_Text, Field(description="cable and wiring, such as 6-wire, 3 m")] = ""
    amplifier_serial: Annotated[_Text, Field(description="type and serial of the amplifier")] = ""
