"""The muscle: a geometry and the force terms that act in it."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._compiled import compiled
from .._types import Real, RealArray, as_real
from ..geometries.dimensions import AbstractGeometry
from ..materials.abstract_material import AbstractMaterial
from ..terms import AbstractForceTerm, BladderWall, PressurisedBraid, SumOfTerms
from .abstract_muscle import AbstractMuscle
from .one_muscle import check_one_muscle


class Muscle(AbstractMuscle):
    """A fluidic artificial muscle in static equilibrium: the sum of its force terms in a geometry.

    Of a pressurised braid and a bladder it is the force balance

    F = F_G(P - P_d) + sigma_z V / L - sigma_c t L^2 / (2 pi R N^2)

    The force is that of the model, not clipped, as roots and gradients need it: where it is below
    zero a real muscle is slack, buckles and pulls nothing, and below the deadband the formula is an
    extrapolation. `SafeMuscle`, predictions and exports give no force there.

    Attributes:
        geometry: source of the dimensions; it composes braid and bladder.
        terms: what pulls, a `SumOfTerms`.

    References:
        Ferraresi 2001; Hocking & Wereley 2012; Chambers 2021, equation 6.9.

    >>> import famjax
    >>> braid = famjax.Braid.from_rest(diameter=0.023, braid_angle=1.1, length=0.296)
    >>> shape = famjax.EstimatedGeometry(braid, famjax.Bladder(0.296, 0.023, 1.8e-3, embedded=True))
    >>> rubber = famjax.materials.NeoHookeanMaterial(3e5)
    >>> muscle = Muscle(shape, famjax.terms.PressurisedBraid(40e3) + famjax.terms.BladderWall(rubber))
    >>> print(f"{muscle.force(0.28, 4e5):.1f} {Muscle(shape, rubber, 40e3).force(0.28, 4e5):.1f}")
    765.2 765.2
    """

    geometry: AbstractGeometry
    terms: SumOfTerms

    def __init__(
        self,
        geometry: AbstractGeometry,
        terms: AbstractForceTerm | AbstractMaterial | Sequence[AbstractForceTerm],
        deadband_pressure: Real | None = None,
    ) -> None:
        """The muscle of these terms, or of a pressurised braid and a bladder of this material.

        Args:
            geometry: source of the dimensions.
            terms: a force term, a sum or a sequence of them; or the material of the bladder, which
                stands for `PressurisedBraid(deadband_pressure) + BladderWall(material)`.
            deadband_pressure: P_d [Pa], beside a material only; zero by default. Among terms it is
                the braid's own.

        Raises:
            ValueError: no terms, something else than terms, or a deadband beside terms.
        """
        if not isinstance(geometry, AbstractGeometry):
            raise ValueError(
                "the geometry of a muscle is derived from famjax.geometries.AbstractGeometry, such as "
                f"famjax.EstimatedGeometry(braid, bladder); got {_kind(geometry)}"
            )
        self.geometry = geometry
        if isinstance(terms, AbstractMaterial):
            deadband = 0.0 if deadband_pressure is None else deadband_pressure
            self.terms = SumOfTerms((BladderWall(terms), PressurisedBraid(deadband)))
            return
        if deadband_pressure is not None:
            raise ValueError(
                "the deadband pressure belongs to the term of the pressure, as in "
                f"PressurisedBraid({deadband_pressure}); beside terms it cannot be given"
            )
        if isinstance(terms, AbstractForceTerm):
            terms = (terms,)
        self.terms = SumOfTerms(terms)

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape.

        Nan where the geometry cannot be: at a negative length, beyond the threads' length, outside
        the measured lengths, where a soft braid gives way.
        """
        return _pull(self.geometry, self.terms, as_real(length), as_real(pressure))

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Shortest and longest active length [m] between which an equilibrium is looked for."""
        return self.geometry.length_range()

    def stops(self) -> Float[Array, "2"]:
        """Lengths [m] at which the braid locks and at which its threads are straight, if it has one."""
        limits, known = jnp.stack(self.geometry.braid_limits()), jnp.stack(self.length_range())
        return jnp.where(jnp.isfinite(limits), limits, known)

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Volume V [m3] of the fluid, the geometry's `inner_volume`, broadcast shape."""
        return self.geometry.inner_volume(length, pressure)

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction: the geometry's."""
        return self.geometry.rest_length

    @property
    def material(self) -> AbstractMaterial:
        """The material of the first term that has one.

        Raises:
            AttributeError: no term has one.
        """
        return self._holding("material")[0].material

    @property
    def deadband_pressure(self) -> RealArray:
        """P_d [Pa] of the first term that has one.

        Raises:
            AttributeError: no term has one.
        """
        return self._holding("deadband_pressure")[0].deadband_pressure

    def braid_force(self, length: Real, pressure: Real) -> RealArray:
        """Pull [N] of the pressure alone, of the terms with a deadband pressure, broadcast shape."""
        terms = SumOfTerms(self._holding("deadband_pressure"))
        return _pull(self.geometry, terms, as_real(length), as_real(pressure))

    def bladder_force(self, length: Real, pressure: Real) -> RealArray:
        """Pull [N] of the bladder alone, of the terms with a material; negative where it resists."""
        terms = SumOfTerms(self._holding("material"))
        return _pull(self.geometry, terms, as_real(length), as_real(pressure))

    def _holding(self, field: str) -> tuple:
        """The terms that have this field."""
        holding = tuple(term for term in self.terms.terms if hasattr(term, field))
        if not holding:
            kinds = ", ".join(type(term).__name__ for term in self.terms.terms)
            raise AttributeError(
                f"no term of this muscle has a {field}; its terms are {kinds}. Read the term itself, "
                "as in muscle.terms.terms[0]"
            )
        return holding


@compiled
def _pull(
    geometry: AbstractGeometry, terms: SumOfTerms, length: RealArray, pressure: RealArray
) -> RealArray:
    """The force [N] of some terms, nan where the muscle cannot be."""
    check_one_muscle(geometry, terms)  # a stack of muscles was never constructed
    length, pressure = jnp.broadcast_arrays(length, pressure)
    rated = any(term.uses_rates for term in terms.terms)
    dimensions = geometry.dimensions_with_rates if rated else geometry.dimensions
    at = dimensions(length, pressure)
    if not geometry.keeps_apart:
        # A geometry of a user's own is asked once more, of states that there are, for the same reason.
        there = at.reached & jnp.isfinite(pressure)
        length = jnp.where(there, length, jax.lax.stop_gradient(geometry.rest_length))
        at = dimensions(length, jnp.where(there, pressure, 0.0)).unless(there)
    # Terms see numbers everywhere: what is nan would spoil the derivatives of all others in a batch.
    reached = at.reached & (length > 0) & jnp.isfinite(pressure)
    force = terms.force(at.where(reached), jnp.where(reached, pressure, 0.0))
    return jnp.where(reached, force, jnp.nan)


def _kind(value: object) -> str:
    return f"the class {value.__name__}" if isinstance(value, type) else f"a {type(value).__name__}"
