"""What is known of the errors that all readings of a force map have in common."""

import dataclasses
import math

from famjax.boundary.errors import InputError
from famjax.boundary.toml_file import Form, NotNegative

from .force_data import ForceData

FORM = Form(
    kinds={
        "rest_length": "length", "pressure_zero": "pressure", "force_zero": "force",
        "wall_thickness": "length", "bladder_diameter": "length", "braid_thickness": "length",
    }
)  # fmt: skip
"""How they are spelt: `wall_thickness_mm`, `pressure_reading`."""


@dataclasses.dataclass(frozen=True)
class SharedErrors:
    """Standard errors of what all readings of a map have in common; 0 where it is exact.

    Attributes:
        rest_length: of L0, and of every length with it [m].
        shortening: of the machine's displacement, as part of it.
        pressure_reading: of the transducer, as part of the reading.
        pressure_zero: of its zero [Pa].
        force_reading: of the load cell, as part of the reading.
        force_zero: of its zero [N].
        wall_thickness: of the bladder's wall at rest [m].
        bladder_diameter: of its outer diameter at rest [m], where it was given.
        braid_thickness: [m].
    """

    rest_length: NotNegative = 0.0
    shortening: NotNegative = 0.0
    pressure_reading: NotNegative = 0.0
    pressure_zero: NotNegative = 0.0
    force_reading: NotNegative = 0.0
    force_zero: NotNegative = 0.0
    wall_thickness: NotNegative = 0.0
    bladder_diameter: NotNegative = 0.0
    braid_thickness: NotNegative = 0.0

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"the standard error of {name} must be >= 0, got {value}")

    def stated(self) -> dict[str, float]:
        """Those that are not 0."""
        return {name: value for name, value in dataclasses.asdict(self).items() if value > 0}

    def moved(self, data: ForceData, name: str) -> ForceData:
        """A map as it would be, were one of the errors its standard error.

        Args:
            data: the map.
            name: of the error.

        Raises:
            InputError: an error of a bladder's diameter that was not given.
        """
        by, length, pressure, force = getattr(self, name), data.length, data.pressure, data.force
        specimen = data.specimen
        match name:
            case "rest_length":
                length = length + by
                specimen = dataclasses.replace(specimen, rest_length=specimen.rest_length + by)
            case "shortening":
                length = specimen.rest_length - (specimen.rest_length - length) * (1 + by)
            case "pressure_reading":
                pressure = pressure * (1 + by)
            case "pressure_zero":
                pressure = pressure + by
            case "force_reading":
                force = force * (1 + by)
            case "force_zero":
                force = force + by
            case "bladder_diameter" if specimen.bladder_diameter is None:
                raise InputError(
                    "an error of bladder_diameter was given and no bladder_diameter: the bladder "
                    "fills the braid, leave the error out"
                )
            case _:
                specimen = dataclasses.replace(specimen, **{name: getattr(specimen, name) + by})
        return dataclasses.replace(
            data, length=length, pressure=pressure, force=force, specimen=specimen
        )
