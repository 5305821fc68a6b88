"""A family of models: named numbers in, a model with a force out; some numbers linear in the force."""

import abc
from collections.abc import Mapping
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

Values = Mapping[str, Any]
"""Numbers [SI] by name."""

RIG = ("series_compliance", "series_exponent")
"""Parameters of the rig, which no model sees: compliance and exponent of `famjax.muscle.give_way`."""


class AbstractFamily(eqx.Module):
    """Models of one specimen as a function of named numbers.

    Whatever is an array in it may differ from one specimen to another without a new program; what
    is static (names, classes) may not.

    Attributes:
        nonlinear: names of the numbers that are searched, in order.
        linear: names of those in which the force is affine, in order.
    """

    nonlinear: eqx.AbstractVar[tuple[str, ...]]
    linear: eqx.AbstractVar[tuple[str, ...]]

    @abc.abstractmethod
    def build(self, values: Values) -> Any:
        """The model of these values: whatever has `force(length, pressure)`."""

    @abc.abstractmethod
    def rest_length(self, values: Values) -> Float[Array, ""]:
        """Active length L0 [m] at which every actuation path starts."""

    @property
    def identity(self) -> Any:
        """What the models follow from, besides the numbers in arrays: by it tapes are kept."""
        return self

    @property
    def derived_names(self) -> tuple[str, ...]:
        """Names of what `derived` returns."""
        return ()

    def derived(self, values: Values) -> tuple[Float[Array, ""], ...]:
        """What else a reader wants to know of the model; differentiable."""
        del values
        return ()
