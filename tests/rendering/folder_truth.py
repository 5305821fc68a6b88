"""What a twin is made from: a muscle, a test, a rig and a camera, as a file that a person can edit."""

import dataclasses
from pathlib import Path
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np

import famjax
from famjax.boundary import toml_file
from famjax.boundary.toml_file import NotNegative, Positive
from famjax.units import INCH, PSI
from fitting.evidence import FORM as SHARED_ERRORS, SharedErrors

from .muscle import stroke_shape

TRUTH = "truth.toml"  # in a twin's folder; no step of an evaluation reads it
MOST = 0.35  # contraction up to which the shapes are known

STATED = SharedErrors(
    rest_length=0.005 * INCH, wall_thickness=0.0003 * INCH, bladder_diameter=0.002 * INCH,
    braid_thickness=0.0003 * INCH, pressure_reading=1e-3, pressure_zero=0.05 * PSI,
    force_reading=1e-3,
)  # fmt: skip
"""Standard errors of what the laboratory says of muscle and sensors."""

_REST, _BORE = 9.28125 * INCH, 0.875 * INCH  # of the reference work's muscle
_THREAD = 9.89 / 9.28125  # of the rest length


@dataclasses.dataclass(frozen=True)
class TwinMuscle:
    """A muscle with the reference work's shapes, in any size, and any law; SI."""

    coefficients: tuple[float, ...]
    deadband: NotNegative
    turns: Positive
    rest_length: Positive = _REST
    bladder_diameter: Positive = _BORE
    wall_thickness: Positive = 0.0625 * INCH
    braid_thickness: NotNegative = 0.011 * INCH
    friction: NotNegative = 0.01  # part of the force by which the branches differ from their mean

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> "TwinMuscle":
        """Within a tenth of the reference work's, stable."""
        law = np.array([257.8, -57.9, 32.7]) * PSI * (1 + rng.uniform(-0.1, 0.1, 3))
        deadband, turns = rng.uniform(2e3, 12e3), 1.09 * (1 + rng.uniform(-0.02, 0.02))
        return cls(tuple(law.tolist()), float(deadband), float(turns))

    def shape(self, contraction: float) -> Any:
        """Diameter [m] over z/L at a contraction from 0 to `MOST`."""
        widening = self.bladder_diameter / _BORE
        known = stroke_shape(contraction, _BORE)
        return known if widening == 1 else lambda x: widening * known(x)

    def muscle(self) -> famjax.Muscle:
        """As a model: the shape that the camera sees, and the law."""
        x, c, rest = np.linspace(0, 1, 201), np.linspace(0.0, MOST, 29), self.rest_length
        shapes = np.stack([np.asarray(self.shape(float(one))(x)) for one in c])
        braid = famjax.Braid(_THREAD * rest, self.turns, self.braid_thickness)
        surface = famjax.surfaces.SampledSurface(
            lengths=rest * (1 - c), pressures=[0.0], diameters=shapes[None], braid=braid, margin=0.0
        )
        bladder = famjax.Bladder(rest, self.bladder_diameter, self.wall_thickness)
        law = famjax.PolynomialMaterial(jnp.array(self.coefficients))
        return famjax.Muscle(famjax.MeasuredGeometry(surface, bladder), law, self.deadband)


@dataclasses.dataclass(frozen=True)
class TwinRig:
    """The test, the rig and the machine, SI."""

    pressures: tuple[float, ...]
    cycles: int
    stroke: Positive
    rate: Positive = 0.1 * INCH
    settle: NotNegative = 6.0
    clock_ahead: float = 0.0  # reading of the machine's clock when the journal begins
    clock_drift: float = 0.0  # by which it gains, s per s
    lost: NotNegative = 0.0  # time of the log that is missing in its middle half


@dataclasses.dataclass(frozen=True)
class TwinCamera:
    """The camera and its ruler, SI."""

    pictures: int  # evenly over the test
    rows: int
    jitter: NotNegative = 0.01  # standard deviation of the shutter's delay
    clock_ahead: float = 0.0  # of the journal's
    clock_drift: float = 0.0
    electrons: Positive = 1900.0  # of a white pixel
    read_noise: NotNegative = 3.0
    ruler_offset: float = 0.0  # behind the plane of the axis
    damaged: int = 0  # pictures in the middle half that are cut short


@dataclasses.dataclass(frozen=True)
class TwinErrors:
    """What the laboratory is wrong by, as said less as it is, of what `STATED` says how wrong."""

    rest_length: float = 0.0
    wall_thickness: float = 0.0
    bladder_diameter: float = 0.0
    braid_thickness: float = 0.0
    pressure_reading: float = 0.0
    pressure_zero: float = 0.0
    force_reading: float = 0.0

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> "TwinErrors":
        names = [field.name for field in dataclasses.fields(cls)]
        return cls(*(float(rng.normal(0, getattr(STATED, name))) for name in names))


@dataclasses.dataclass(frozen=True)
class Truth:
    """All that a twin is made from, but for the seed of its noise."""

    muscle: TwinMuscle
    rig: TwinRig
    camera: TwinCamera
    errors: TwinErrors


_SIZES: dict[str, tuple[tuple[float, ...], int, float, int, int]] = {
    "small": ((40.0, 70.0, 100.0), 2, 2.4, 36, 900),
    "large": (tuple(range(10, 101, 10)), 3, 3.1, 200, 1200),
}
"""Set pressures [psi], cycles, stroke [in], pictures, rows."""

_FORM = toml_file.Form({
    **SHARED_ERRORS.kinds, "rate": "rate",
    **dict.fromkeys(("coefficients", "deadband", "pressures"), "pressure"),
    **dict.fromkeys(("stroke", "ruler_offset"), "length"),
    **dict.fromkeys(("settle", "clock_ahead", "lost", "jitter"), "time"),
})  # fmt: skip


def drawn_truth(seed: int, size: Literal["small", "large"], *, flawed: bool) -> Truth:
    """The truth of a seed: a muscle near the reference work's; clocks, a ruler and sensors that are off."""
    rng = np.random.default_rng(seed)
    muscle, ruler = TwinMuscle.drawn(rng), float(rng.normal(0, 0.01 * INCH))
    pressures, cycles, stroke, pictures, rows = _SIZES[size]
    return Truth(
        muscle,
        TwinRig(
            tuple(P * PSI for P in pressures), cycles, stroke * INCH,
            clock_ahead=float(rng.uniform(-20, 20)), clock_drift=float(rng.uniform(-60e-6, 60e-6)),
            lost=1.0 if flawed else 0.0,
        ),
        TwinCamera(
            pictures, rows,
            clock_ahead=float(rng.uniform(-300, 300)), clock_drift=float(rng.uniform(-30e-6, 30e-6)),
            ruler_offset=ruler, damaged=1 if flawed else 0,
        ),
        TwinErrors.drawn(rng),
    )  # fmt: skip


def read_truth(path: Path, drawn: Truth) -> Truth:
    """A truth from a file; what the file does not say is as drawn."""
    content = toml_file.read_toml(path, "truth")
    entries = {name: _merged(content.get(name, {}), part) for name, part in vars(drawn).items()}
    return toml_file.from_entries(Truth, entries, _FORM, where=f"{path}: ")


def truth_text(truth: Truth) -> str:
    return toml_file.toml_text(toml_file.to_entries(truth, _FORM)).lstrip("\n")


def _merged(given: Any, drawn: Any) -> Any:
    """The entries of a table, and those drawn of the fields that they do not name, in whatever unit."""
    kept = {
        _FORM.key(field.name): getattr(drawn, field.name)
        for field in dataclasses.fields(drawn)
        if not any(
            key == field.name or (field.name in _FORM.kinds and key.startswith(f"{field.name}_"))
            for key in given
        )
    }
    return {key: list(one) if isinstance(one, tuple) else one for key, one in kept.items()} | given
