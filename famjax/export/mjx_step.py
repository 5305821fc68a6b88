"""MJX: the muscle's force inside the step, by the model itself, so that it can be differentiated."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import jax.numpy as jnp

from .._types import Real
from ..boundary.errors import InputError
from ..cards.card import card_as_document
from ..cards.document import as_text
from ..muscle import AbstractMuscle
from .mujoco_model import hanging_load
from .subject import Subject

if TYPE_CHECKING:
    from mujoco import mjx


def pulled(
    model: "mjx.Model", data: "mjx.Data", muscles: Mapping[int, tuple[AbstractMuscle, Real]]
) -> "mjx.Data":
    """The data with the muscles' pull at the tendons' present lengths as controls of their motors.

    Call it before each `mjx.step`; it can be jitted, mapped, and differentiated by every number of
    the muscles. MJX takes no user actuators: a muscle's is a motor of gain 1 on its tendon.

    Args:
        model: of MJX.
        data: positions; tendon lengths in them may be older.
        muscles: muscle and gauge pressure [Pa] by the number of the actuator.
    """
    from mujoco import mjx  # noqa: PLC0415 -- an extra of the project

    placed = mjx.tendon(model, mjx.com_pos(model, mjx.kinematics(model, data)))
    control = jnp.asarray(data.ctrl)
    for number, (muscle, pressure) in muscles.items():
        tendon = int(model.actuator_trnid[number, 0])
        length = placed.ten_length[tendon]
        control = control.at[number].set(-muscle.force(length, pressure))
    return data.replace(ctrl=control)


def mjx_files(subject: Subject) -> dict[str, bytes]:
    """`NAME_mjx.xml` with a motor, the card, and `NAME_mjx.py` with the step; needs famjax.

    Raises:
        InputError: the muscle is not of a card.
    """
    if subject.card is None:
        raise InputError(
            "an MJX model takes its muscle from a card, and this one has none: call "
            "famjax.export.pulled with the muscle itself"
        )
    name = subject.identifier
    about = "\n".join(subject.about).replace("\\", "/").replace('"""', "'''")
    module = f'''"""{about}

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
    return mjx.step(MODEL, famjax.export.pulled(MODEL, data, {{0: (muscle, pressure)}}))
'''
    xml = hanging_load(subject, 'gainprm="1" biastype="none"', pressure=False)
    return {
        f"{name}_mjx.xml": xml.encode(),
        f"{name}_card.json": as_text(card_as_document(subject.card)).encode(),
        f"{name}_mjx.py": module.encode(),
    }
