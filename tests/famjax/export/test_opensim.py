"""The OpenSim model: an ideal braid exactly, its properties those of the actuator's class."""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import pytest

import famjax
from famjax.boundary.errors import InputError
from famjax.export import Subject, export, ideal_braid

# McKibbenActuator.h of OpenSim 4.6, and what its base classes PathActuator and Component declare.
PROPERTIES = {"thread_length", "number_of_turns", "cord_length", "GeometryPath"}


class IdealBraid(famjax.AbstractMuscle):
    """P (3 L^2 - B^2)/(4 pi N^2)."""

    braid: famjax.Braid
    rest_length: float = eqx.field(converter=jnp.asarray)

    def force(self, length, pressure):
        B, N = self.braid.rest_thread_length, self.braid.turns
        return pressure * (3 * length**2 - B**2) / (4 * math.pi * N**2)

    def length_range(self):
        return 0.5 * self.rest_length, 1.1 * self.rest_length


def test_an_ideal_braid_is_itself() -> None:
    muscle = IdealBraid(famjax.Braid(0.33, 2.15), 0.29)
    safe = famjax.SafeMuscle.of(muscle, [0.23, 0.29], [0.0, 6e5])
    assert ideal_braid(Subject("braid", safe)) == pytest.approx((0.33, 2.15), rel=1e-6)


def test_the_model_names_the_properties_of_the_class(subject: Subject, tmp_path: Path) -> None:
    (file,) = export(subject, ["opensim"], tmp_path)
    (actuator,) = ET.parse(file).iter("McKibbenActuator")
    assert {part.tag for part in actuator} == PROPERTIES
    B, N = ideal_braid(subject)
    assert float(actuator.findtext("thread_length") or 0) == B
    assert float(actuator.findtext("number_of_turns") or 0) == N
    head = ET.parse(file).findtext("Model/credits") or ""
    assert "without bladder, deadband, slack or stops: off by up to" in head


def test_a_name_that_xml_would_read(odd_subject: Subject, tmp_path: Path) -> None:
    (file,) = export(odd_subject, ["opensim"], tmp_path)
    assert odd_subject.name in (ET.parse(file).findtext("Model/credits") or "")


def test_opensim_computes_the_same_force(subject: Subject, tmp_path: Path) -> None:
    opensim = pytest.importorskip("opensim", reason="OpenSim is not installed")
    (file,) = export(subject, ["opensim"], tmp_path)
    model = opensim.Model(str(file))
    state = model.initSystem()
    actuator = opensim.McKibbenActuator.safeDownCast(model.getForceSet().get("test_20"))
    B, N = ideal_braid(subject)
    for length in (0.23, 0.26, 0.29):
        model.getCoordinateSet().get("length").setValue(state, length)
        model.realizeVelocity(state)
        model.setControls(state, opensim.Vector(1, 4e5))
        model.realizeDynamics(state)
        force = 4e5 * (3 * length**2 - B**2) / (4 * math.pi * N**2)
        assert actuator.getActuation(state) == pytest.approx(force, rel=1e-9)


def test_a_muscle_that_no_braid_resembles(subject: Subject) -> None:
    class Bellows(famjax.AbstractMuscle):
        rest_length: float = eqx.field(converter=jnp.asarray, default=0.3)

        def force(self, length, pressure):
            return 1e-4 * pressure + 1e3 * (length - 0.2)

        def length_range(self):
            return jnp.asarray(0.1), jnp.asarray(0.4)

    safe = famjax.SafeMuscle.of(Bellows(), [0.2, 0.3], [0.0, 5e5])
    with pytest.raises(InputError, match="cannot stand for it"):
        ideal_braid(Subject("bellows", safe))
