"""What a stress law of the bladder is. Engineering strain in, true stress out."""

import abc
from typing import ClassVar

import jax
import jax.numpy as jnp

from .._types import Real, RealArray, as_real
from ..parameters import Parametrised


class AbstractMaterial(Parametrised):
    """A bladder material in the force balance: two strains in, two true stresses out.

    Class variables:
        directions_interact: the stress in one direction depends on the strain in the other, so that
            the law has no one-dimensional tangent modulus.
        depends_on_pressure: the stresses depend on the pressure, so that stability is asked for at
            every pressure.
        law_name: by which the command line knows the law; "" for laws that it does not.
    """

    directions_interact: ClassVar[bool] = True
    depends_on_pressure: ClassVar[bool] = True
    law_name: ClassVar[str] = ""

    @abc.abstractmethod
    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True stresses (sigma_z, sigma_c) [Pa], positive in tension.

        Args:
            axial_strain: eps_z [-], engineering, negative when the muscle is shorter.
            hoop_strain: eps_c [-], engineering, at mid-wall.
            pressure: gauge pressure P [Pa]; ignored by laws that do not depend on it.

        Returns:
            (sigma_z, sigma_c) [Pa], each of the broadcast shape.
        """


def tangent_modulus(material: AbstractMaterial, strain: Real, pressure: Real = 0.0) -> RealArray:
    """Tangent modulus dsigma/deps [Pa] of one direction, which a law without interaction has.

    Args:
        material: stress law whose two directions do not interact.
        strain: eps [-], engineering.
        pressure: gauge pressure P [Pa]; ignored by laws that do not depend on it.

    Returns:
        The modulus [Pa], broadcast shape.

    Raises:
        ValueError: the two directions of the law interact, so that there is no such modulus.

    >>> from famjax import PolynomialMaterial
    >>> print(f"{tangent_modulus(PolynomialMaterial([2.0, 3.0]), 0.5):.1f}")
    5.0
    """
    if material.directions_interact:
        raise ValueError(
            f"{type(material).__name__} has no tangent modulus of one direction: its stress depends "
            "on both strains. Use path_modulus along the path of the muscle, and path stability as "
            "constraint; a law of one direction says so by directions_interact = False"
        )
    strains, pressures = jnp.broadcast_arrays(as_real(strain), as_real(pressure))
    along = jnp.ones_like(strains)
    return jax.jvp(lambda e: material.stresses(e, e, pressures)[0], (strains,), (along,))[1]
