"""What a force term is, and the sum of several."""

import abc
import functools
import operator
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import Real, RealArray
from ..geometries.dimensions import Dimensions
from ..parameters import Parametrised


class AbstractForceTerm(Parametrised):
    """One part of a muscle's pull. Terms are added: `PressurisedBraid() + BladderWall(material)`.

    A term reads the muscle's state and nothing else, so that it works in every geometry. Its own
    numbers are declared with `famjax.parameter`, to be identified with those of the muscle.

    Class variables:
        uses_rates: the term reads `at.rates`, the derivatives of the dimensions in the length.
    """

    uses_rates: ClassVar[bool] = False

    @abc.abstractmethod
    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """This term's part of the pull [N], broadcast shape, positive where it shortens the muscle.

        Args:
            at: dimensions of the muscle at its length and pressure.
            pressure: gauge pressure P [Pa].
        """

    def __add__(self, other: object) -> "SumOfTerms":
        """Both terms, as one sum."""
        if not isinstance(other, AbstractForceTerm):
            return NotImplemented
        return SumOfTerms((self, other))

    def __radd__(self, other: object) -> "AbstractForceTerm":
        """The term itself, added to the 0 that sum([...]) starts from."""
        return self if isinstance(other, int) and other == 0 else NotImplemented


class SumOfTerms(AbstractForceTerm):
    """Several terms, whose forces add. Sums within it are dissolved.

    Attributes:
        terms: one or more.
    """

    terms: tuple[AbstractForceTerm, ...]

    def __init__(self, terms: Sequence[eqx.Module]) -> None:
        """See the class.

        Args:
            terms: force terms, one or more.

        Raises:
            ValueError: there is no term, or something else among them.
        """
        flat: list[AbstractForceTerm] = []
        for term in terms if isinstance(terms, tuple | list) else [terms]:
            if not isinstance(term, AbstractForceTerm):
                raise ValueError(
                    "a force term is derived from famjax.terms.AbstractForceTerm and has the method "
                    f"force(at, pressure); got {term!r}. A bladder material becomes a "
                    "term by famjax.terms.BladderWall(material)"
                )
            flat.extend(term.terms if isinstance(term, SumOfTerms) else [term])
        if not flat:
            raise ValueError(
                "a muscle needs at least one force term, got none: give, for instance, "
                "PressurisedBraid() + BladderWall(material)"
            )
        self.terms = tuple(flat)

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The sum of the terms' forces [N], broadcast shape."""
        forces = [_of_term(term, at, pressure) for term in self.terms]
        return functools.reduce(operator.add, forces)


def _of_term(term: AbstractForceTerm, at: Dimensions, pressure: Real) -> RealArray:
    """The force of a term [N].

    Raises:
        ValueError: it is not one number for each state.
    """
    force = term.force(at, pressure)
    wanted = jnp.shape(at.length)
    shape = force.shape if isinstance(force, jax.Array | np.ndarray) else np.shape(force)
    alone = not isinstance(force, tuple | list | None)
    if not alone or len(shape) > len(wanted) or jnp.broadcast_shapes(shape, wanted) != wanted:
        came = f"the shape {shape}" if alone else f"a {type(force).__name__}"
        raise ValueError(
            f"force(at, pressure) of {type(term).__name__} must return one force [N] for each state, "
            f"here of the shape {wanted}, that of at.length; got {came}"
        )
    return jnp.asarray(force)
