"""Safety factors: what failed in a test over what is asked for in use."""

import dataclasses
from collections.abc import Iterable
from typing import Literal

import jax.numpy as jnp

from .._types import Real, RealArray
from ..braids.thread import thread_tension
from .catalogue import Catalogue, CatalogueTest
from .catalogue_search import DesignCandidate, Requirement

Failing = Literal["burst_pressure", "burst_force", "tensile_force"]
"""The numbers of a `CatalogueTest`."""


def safety_factor(failure: Real, working: Real) -> RealArray:
    """Safety factor [-]: the load or pressure that failed in a test over the greatest one in use.

    Args:
        failure: burst pressure [Pa] or tensile failure load [N].
        working: greatest pressure [Pa] or pull [N] in use, of the same kind.

    Returns:
        Factor [-], broadcast shape.

    References:
        Chambers 2021, chapter 2: 280 psi and 2147 lbf.

    >>> print(f"{safety_factor(280, 100):.1f} {safety_factor(2147, 1049):.2f}")  # psi; lbf
    2.8 2.05
    """
    return jnp.asarray(failure) / working


def thread_strength_margin(
    force: Real,
    pressure: Real,
    radius: Real,
    braid_angle: Real,
    *,
    n_threads: Real,
    breaking_load: Real,
) -> RealArray:
    """Strength margin of the threads [-]: the load that breaks one over its tension in use.

    The tension is that of `famjax.braids.thread_tension`; all threads are taken to carry the same.

    Args:
        force: pull F [N] of the muscle.
        pressure: gauge pressure P [Pa].
        radius: braid radius R [m].
        braid_angle: theta [rad], from the circumference.
        n_threads: n [-], of both families.
        breaking_load: of one thread [N].

    Returns:
        Factor [-], broadcast shape; 1 where a thread breaks.

    References:
        Chambers 2021, section 5.1: a thread breaks at 59.3 lbf.

    >>> margin = thread_strength_margin(1058, 100, 0.522, 1.2032, n_threads=144, breaking_load=59.3)
    >>> round(float(margin), 1)  # psi, in, lbf
    7.0
    """
    tension = thread_tension(force, pressure, radius, braid_angle, n_threads)
    return safety_factor(breaking_load, tension)


@dataclasses.dataclass(frozen=True)
class SafetyFactor:
    """One test of a muscle held against one demand on it.

    Attributes:
        test: row of the catalogue.
        quantity: which of its numbers.
        failure: that number, [Pa] or [N].
        demand: "required pressure", "required force" or "blocked force", the pull that the muscle
            reaches at the required pressure if it is held at its rest length.
        working: what is demanded, [Pa] or [N].
        factor: failure over working [-].
    """

    test: CatalogueTest
    quantity: Failing
    failure: float
    demand: str
    working: float
    factor: float

    @property
    def kind(self) -> Literal["pressure", "force"]:
        """What failed and is demanded."""
        return "pressure" if self.quantity == "burst_pressure" else "force"


def safety_factors(
    catalogue: Catalogue, requirement: Requirement, candidates: Iterable[DesignCandidate]
) -> list[SafetyFactor]:
    """The safety factors of every tested muscle of the catalogue.

    Pressures are held against the required pressure. Forces are held against the required force,
    where one is asked for, and against the muscle's blocked force, unless its braid does not fit.

    Args:
        catalogue: from `load_catalogue`.
        requirement: in SI.
        candidates: from `search` with that catalogue and requirement; they give the blocked force.

    Returns:
        The factors, in the order of the tests.
    """
    blocked = {(c.bladder.name, c.braid.name): c.blocked_force for c in candidates}
    found = []
    for test in catalogue.tests:
        forces = {
            "required force": requirement.force,
            "blocked force": blocked[test.bladder, test.braid],
        }
        demands: dict[Failing, dict[str, float]] = {
            "burst_pressure": {"required pressure": requirement.pressure},
            "burst_force": forces,
            "tensile_force": forces,
        }
        for quantity, of in demands.items():
            failure = getattr(test, quantity)
            found += [
                SafetyFactor(
                    test, quantity, failure, demand, working, float(safety_factor(failure, working))
                )
                for demand, working in of.items()
                if failure is not None and working > 0
            ]
    return found
