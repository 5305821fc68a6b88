"""A braid of linear threads known by one number, their compliance, which may be zero."""

import jax.numpy as jnp
from jaxtyping import Float

from .._types import Given, Real, RealArray, as_real
from ..parameters import number, parameter
from .inextensible import AbstractBraid, Braid

_HIGHEST_COMPLIANCE = 3e-5  # 1/N


class CompliantBraid(AbstractBraid):
    """A braid whose threads stretch in proportion to their tension, under Gaylord's own force.

    B = B0 / (1 - C B0 P L / (2 pi N^2)),  C = 1 / (n A_b E_b)

    The closed form of `ElasticBraid` with linear threads. It needs neither the number of threads
    nor their section, has no root to solve, and is smooth at C = 0, where the braid is
    inextensible: what an identification wants.

    Attributes:
        rest_thread_length: B0 [m].
        turns: N [-].
        thickness: t_braid [m].
        compliance: C [1/N], >= 0, strain of the threads per tension of all of them together.

    References:
        Davis et al. 2003 (stretching braid); Chambers 2021, section 5.1.

    >>> kevlar = CompliantBraid(9.89, 1.09, 0.011, 1 / (144 * 1.332e-4 * 11.6e6))  # inches, psi
    >>> print(f"{kevlar.thread_length(9.28125, 100.0):.3f}")
    9.945
    """

    rest_thread_length: Float[Given, "..."] = parameter("m", low=0.0)
    turns: Float[Given, "..."] = parameter(low=0.0)
    thickness: Float[Given, "..."] = number("m")
    compliance: Float[Given, "..."] = parameter(
        "1/N", name="braid_compliance", low=0.0, high=_HIGHEST_COMPLIANCE
    )

    @classmethod
    def of(cls, braid: Braid, compliance: Real) -> "CompliantBraid":
        """The same braid with compliant threads."""
        return cls(braid.rest_thread_length, braid.turns, braid.thickness, compliance)

    def thread_length(self, length: Real, pressure: Real) -> RealArray:
        """Thread length B [m], broadcast shape; nan where the braid gives way without limit."""
        length, pressure = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        load = self.rest_thread_length * pressure * length / (2 * jnp.pi * self.turns**2)
        left = 1 - self.compliance * load
        holds = left > 0
        return jnp.where(holds, self.rest_thread_length / jnp.where(holds, left, 1.0), jnp.nan)
