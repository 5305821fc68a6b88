"""MJX: the muscle's force inside the step, by the model itself, so that it can be differentiated."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp

from .._arrays import Real
from ..boundary.errors import InputError
from ..cards.card import card_as_document
from ..cards.document import as_text
from ..muscle import AbstractMuscle
from .mujoco_model import hanging_load
from .subject import Subject
from .templated import docstring

if TYPE_CHECKING:
    from mujoco import mjx


def mjx_step(
    model: "mjx.Model",
    data: "mjx.Data",
    muscles: Mapping[int, tuple[AbstractMuscle, Real]],
    offsets: Mapping[int, Real] | None = None,
) -> "mjx.Data":
    """One step of MJX with muscles, which pull at the lengths that their tendons have at its start.

    It can be jitted, scanned, mapped, and differentiated by every number of the muscles. MJX takes
    no user actuators: a muscle's is a motor of gain 1 on its tendon, without limits.

    Args:
        model: of MJX.
        data: the state.
        muscles: muscle and gauge pressure [Pa] by the number of the actuator.
        offsets: what a muscle is longer than its tendon [m], by the same number; 0 unless given. A tendon
            of `fixed` type has the length 0 where its joints do.

    Returns:
        The state after the step.
    """
    from mujoco import mjx  # noqa: PLC0415 -- an extra of the project

    placed = mjx.tendon(model, mjx.com_pos(model, mjx.kinematics(model, data)))
    control = jnp.asarray(data.ctrl)
    for number, (muscle, pressure) in muscles.items():
        tendon = placed.ten_length[int(model.actuator_trnid[number, 0])]
        length = tendon + (offsets or {}).get(number, 0.0)
        control = control.at[number].set(-muscle.force(length, pressure))
    after = mjx.step(model, data.replace(ctrl=control))
    # In float64 MJX widens integers of tendons, which a scan does not take.
    return jax.tree.map(lambda new, old: new.astype(old.dtype), after, data)


def mjx_files(subject: Subject) -> dict[str, bytes]:
    """`NAME_mjx.xml` with a motor, the card, and `NAME_mjx.py` with the step; needs famjax.

    Raises:
        InputError: the muscle is not of a card.
    """
    if subject.card is None:
        raise InputError(
            "an MJX model takes its muscle from a card, and this one has none: call "
            "famjax.export.mjx_step with the muscle itself"
        )
    name, offset = subject.identifier, subject.tendon_offset or 0.0
    module = f'''"""{docstring(subject.about)}

The force is the model's own, not a table's. Float64 in JAX for its digits.
"""

from pathlib import Path

import mujoco
from mujoco import mjx

import famjax

HERE = Path(__file__).parent
MUSCLE = famjax.cards.read_card(HERE / "{name}_card.json").safe()
MODEL = mjx.put_model(mujoco.MjModel.from_xml_path(str(HERE / "{name}_mjx.xml")))


def step(data, pressure, muscle=MUSCLE):
    """One step at a gauge pressure [Pa]; differentiable by pressure and muscle."""
    return famjax.export.mjx_step(MODEL, data, {{0: (muscle, pressure)}}, {{0: {offset!r}}})
'''
    xml = hanging_load(subject, 'gainprm="1" biastype="none"', pressure=False)
    return {
        f"{name}_mjx.xml": xml.encode(),
        f"{name}_card.json": as_text(card_as_document(subject.card)).encode(),
        f"{name}_mjx.py": module.encode(),
    }
