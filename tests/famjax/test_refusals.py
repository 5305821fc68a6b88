"""What the physics refuses, and the words that say why."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import muscles as known
import numpy as np
import pytest

import famjax
from famjax import Braid, Muscle, materials, peers, terms
from famjax.measured import AverageDiameterGeometry, MeasuredGeometry, Meridian, quadrature
from famjax.profiles import FourierProfile
from famjax.surfaces import MeasuredFamily, SampledSurface

PLAIN, ROUNDED = known.FESTO, famjax.geometries.EndEffectGeometry(known.FESTO_CYLINDER, 1.05)
WAVY, LATER = FourierProfile(1.0, [0.1], [0.0], 3.0), FourierProfile(2.0, [0.1], [0.0], 3.0)
WALL, PULL = terms.BladderWall(known.LATEX), terms.PressurisedBraid()
X, LENGTHS, PRESSURES = np.linspace(0, 1, 21), np.array([0.30, 0.27, 0.25]), np.array([1e5, 5e5])
WIDER = np.array([0.1, 0.5, 1.0])[:, None] * np.ones((2, 1, 1))
BULGED = 0.02 + 0.02 * np.sin(np.pi * X) ** 0.5 * WIDER


def family(lengths: list[float], profiles: list, **options: float) -> MeasuredFamily:
    return MeasuredFamily(lengths, profiles, 100.0, known.INELASTIC, **options)


def cylinder(diameter: float) -> FourierProfile:
    return FourierProfile(diameter, [0.0], [0.0], 1.0)


SHRUNK = family([9.0, 8.0, 7.0, 6.0], [cylinder(D) for D in (0.02, 0.02, 2.0, 0.02)])


def sampled(**change: object) -> SampledSurface:
    given = {
        "lengths": LENGTHS, "pressures": PRESSURES, "diameters": BULGED,
        "braid": Braid(0.32, 1.5, 3e-4),
    } | change  # fmt: skip
    return SampledSurface(**given)  # pyright: ignore[reportArgumentType]


def from_angle(braid_angle: float) -> Braid:
    return Braid.from_rest(diameter=0.0236, braid_angle=braid_angle, length=0.296)


def apart(*names: str, **bounds: tuple[float, float]) -> famjax.parameters.Apart:
    return famjax.take_apart(PLAIN, names, bounds=bounds)


class Bad(terms.AbstractForceTerm):
    """What it returns is said by its number."""

    what: int = 0

    def force(self, at, pressure):
        return [at.hoop_strain, None][self.what]


def pull_of(what: int) -> object:
    return Muscle(known.CYLINDER_10, Bad(what)).force(jnp.array([0.24, 0.23]), 4e5)


RADIANS = r"must lie in \(0, pi/2\] rad.*jnp.deg2rad"
REFUSED: list[tuple[type[Exception], str, Callable[[], object]]] = [
    # Braids: 64 rad is 66.9 deg after ten turns, a muscle like any other and not the one that was meant.
    *((ValueError, RADIANS, lambda angle=angle: from_angle(angle)) for angle in (64, 61.7, -1, 0)),
    # Shapes
    (ValueError, r"one coefficient per term.*\(2,\) and \(3,\)",
     lambda: FourierProfile(1.0, [0.1, 0.2], [0.1, 0.2, 0.3], 5.0)),
    (ValueError, "order must be >= 1, got 0", lambda: quadrature(0)),
    (RuntimeError, "must exceed the braid's thickness",
     lambda: Meridian.of(cylinder(0.02).diameter, 1.0).inset(0.011)),
    (RuntimeError, "enough to leave a bore",
     lambda: Meridian.of(cylinder(0.5).diameter, 9.0).hoop_strain(famjax.Bladder(9.0, 0.9, 0.2))),
    (RuntimeError, "enough to leave a bore",
     lambda: MeasuredGeometry(
         known.two_profiles(known.INELASTIC), famjax.Bladder(known.L0, 1.4, 0.5))),
    # Families of shapes
    (ValueError, "at least two profiles", lambda: family([9.0], [WAVY])),
    (ValueError, r"2 profiles and lengths with shape \(3,\)",
     lambda: family([9.0, 8.0, 7.0], [WAVY, LATER])),
    (ValueError, "must decrease", lambda: family([6.0, 9.0], [WAVY, LATER])),
    (ValueError, "margin must be a fraction", lambda: family([9.0, 6.0], [WAVY, LATER], margin=0.5)),
    (RuntimeError, "must be > 0 from x = 0 to 1", lambda: MeasuredGeometry(SHRUNK, known.SPECIMEN)),
    (RuntimeError, "must be > 0 from x = 0 to 1",
     lambda: AverageDiameterGeometry(SHRUNK, known.SPECIMEN).dimensions(8.5, 100.0)),
    (ValueError, "lengths must decrease", lambda: sampled(lengths=LENGTHS[::-1])),
    (ValueError, "pressures must increase", lambda: sampled(pressures=PRESSURES[::-1])),
    (ValueError, "must have the shape", lambda: sampled(lengths=LENGTHS[:2])),
    (ValueError, "one or two",
     lambda: sampled(pressures=np.array([1.0, 2.0, 3.0]), diameters=np.ones((3, 3, 5)))),
    (ValueError, "must be > 0", lambda: sampled(diameters=BULGED - 0.03)),
    (ValueError, "between 0 and 0.25", lambda: sampled(margin=0.5)),
    # Laws
    (ValueError, "one exponent for each modulus",
     lambda: materials.OgdenMaterial([1.0, 2.0], [2.0])),
    (ValueError, "at least two node pressures",
     lambda: materials.PressurePolynomialMaterial([1e5], [[1.0]])),
    # Muscles
    (ValueError, "at least one force term, got none", lambda: Muscle(known.CYLINDER, ())),
    (ValueError, r"got PolynomialMaterial.*BladderWall", lambda: terms.SumOfTerms([known.LATEX])),
    (ValueError, "cannot be combined with terms", lambda: Muscle(known.CYLINDER, WALL, 3.0)),
    (AttributeError, r"no term in this muscle has a material; .* Pressuri",
     lambda: Muscle(known.CYLINDER, PULL).material),
    (AttributeError, "no term in this muscle has a deadband_pressure",
     lambda: Muscle(known.CYLINDER, WALL).braid_force(9.0, 60.0)),
    (ValueError, r"force\(at, pressure\) of Bad must return one.*got shape", lambda: pull_of(0)),
    (ValueError, r"force\(at, pressure\) of Bad must return one.*got a NoneTyp", lambda: pull_of(1)),
    (TypeError, "unsupported operand", lambda: PULL + known.LATEX),
    (ValueError, "virtual work needs the rate of change of the volume",
     lambda: terms.VirtualWork().force(known.CYLINDER.dimensions(9.0, 60.0), 60.0)),
    (RuntimeError, "no equilibrium length", lambda: PLAIN.length_at_load(1e6, 4e5)),
    (RuntimeError, "no onset pressure", lambda: PLAIN.onset_pressure(0.25, 1e4)),
    (eqx.EquinoxRuntimeError, "exceed the dead length",
     lambda: famjax.cut_to_length(Muscle(ROUNDED, PLAIN.material), 0.01)),
    (eqx.EquinoxRuntimeError, "must be > 0", lambda: famjax.cut_to_length(PLAIN, 0.0)),
    (ValueError, "valid for only one length",
     lambda: famjax.cut_to_length(Muscle(known.GEOMETRIES["measured"](), known.LATEX), 0.1)),
    # Parameters
    (ValueError, "EstimatedGeometry has no parameter 'turns'; it has braid",
     lambda: known.FESTO_CYLINDER.with_parameters({"turns": 1.0})),
    (ValueError, r"one number; got shape \(2,\) for 'E_1'",
     lambda: PLAIN.with_parameters({"E_1": jnp.ones(2)})),
    (ValueError, "field 'geometry' of Muscle has no default", Muscle.template),
    (ValueError, "must satisfy low <= high", lambda: famjax.parameter("m", low=1.0, high=0.0)),
    (ValueError, "scale of a parameter must be finite and > 0",
     lambda: famjax.parameter("m", scale=0.0)),
    (ValueError, "no parameter 'E_9'; it has braid_diameter", lambda: apart("E_9")),
    (ValueError, "named only once", lambda: apart("E_1", "E_1")),
    (ValueError, "'E_2' is not free", lambda: apart("E_1", E_2=(0.0, 1.0))),
    (ValueError, "lower bound of 'E_1' must be below", lambda: apart("E_1", E_1=(1.0, 1.0))),
    (ValueError, "deadband_pressure: no point in R",
     lambda: apart("deadband_pressure", deadband_pressure=(4e4, 5e4)).unbounded),
    # Peers
    (ValueError, "the model has no rest length",
     lambda: peers.Gaylord(known.INELASTIC).blocked_force(60.0)),
    (ValueError, "constants are available for", lambda: peers.Martens.published("DMSP-40-400")),
]  # fmt: skip


@pytest.mark.parametrize(("error", "words", "attempt"), REFUSED)
def test_it_is_refused_in_words(error, words, attempt):
    with pytest.raises(error, match=words):
        attempt()


def test_a_right_angle_is_no_mistake():
    assert from_angle(jnp.asarray(np.pi / 2, jnp.float32)).rest_thread_length > 0
