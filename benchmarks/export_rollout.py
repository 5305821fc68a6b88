"""A rollout of MJX with an exported muscle, differentiated by its first modulus."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import famjax
from famjax import Real
from famjax.cards import MuscleCard
from famjax.export import Subject, export
from famjax.muscle import Region

_PRESSURE, _START = 4e5, 0.01  # Pa; m above the equilibrium of the exported load


def cubic_card() -> MuscleCard:
    """The card of a muscle like the DMSP-20 with a cubic law, of which E_1 is a coefficient."""
    braid = famjax.Braid.from_rest(diameter=23e-3, braid_angle=1.082, length=0.296)
    bladder = famjax.Bladder(0.296, 23e-3, 1.8e-3, embedded=True)
    law = famjax.PolynomialMaterial([5.9e6, -19.0e6, 25.8e6])
    muscle = famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law, 40e3)
    mounted = famjax.MountedMuscle(muscle, jnp.asarray(0.0))
    return MuscleCard("Test-20", (mounted,), np.ones(1), Region([0.225, 0.3], [0.0, 6e5]))


def rollout(folder: Path, steps: int) -> tuple[Callable[[Real], jax.Array], float]:
    """The height [m] of the load after some steps as a function of E_1 [Pa], and E_1 itself.

    Args:
        folder: for the files of `famjax export --to mjx` of `cubic_card`.
        steps: of MuJoCo's default length.
    """
    mujoco: Any = import_module("mujoco")  # an extra of the project, without types
    from mujoco import mjx  # noqa: PLC0415

    export(Subject.of_card(cubic_card()), ["mjx"], folder)
    model = mjx.put_model(mujoco.MjModel.from_xml_path(str(folder / "test_20_mjx.xml")))
    muscle = famjax.cards.read_card(folder / "test_20_card.json").safe()

    def moduli(of: famjax.SafeMuscle) -> jax.Array:
        return of.continued.muscle.terms.terms[0].material.coefficients  # type: ignore[attr-defined]

    def end(first: Real) -> jax.Array:
        changed = eqx.tree_at(moduli, muscle, moduli(muscle).at[0].set(first))
        data = mjx.make_data(model).replace(qpos=jnp.array([_START]))

        def step(data: mjx.Data, _: None) -> tuple[mjx.Data, None]:
            return famjax.export.mjx_step(model, data, {0: (changed, _PRESSURE)}), None

        return jax.lax.scan(step, data, None, length=steps)[0].qpos[0]

    return jax.jit(end), float(moduli(muscle)[0])


def rollout_derivatives(folder: Path, steps: int) -> tuple[float, float]:
    """Derivative [m/Pa] of the load's height by E_1, exact and by central differences.

    Args:
        folder: for the exported files.
        steps: of the rollout.
    """
    end, first = rollout(folder, steps)
    width = 1e-4 * first
    difference = (end(first + width) - end(first - width)) / (2 * width)
    return float(jax.grad(end)(first)), float(difference)
