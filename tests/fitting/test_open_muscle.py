"""A geometry and a whole model of a modeller's own, in twenty lines each; `examples/own_law.py` is a law.

Nothing of the package is edited: classes declare their numbers, and everything works with them.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from maps import cylinder, known_muscle, readings

import famjax
import fitting
from fitting import InputError, Parameter, identify
from fitting.model_families import ModelFamily


class ConicalEnds(famjax.geometries.AbstractGeometry):
    """A cylinder whose ends, cones of the given length, do not take part in the contraction."""

    cylinder: famjax.geometries.AbstractGeometry
    cone_length: Float[Array, ""] = famjax.parameter("m", low=0.0, high=0.05, default=0.0)

    def dimensions(self, length, pressure):
        rest = self.rest_length
        moved = rest + (length - rest) * rest / (rest - self.cone_length)
        return self.cylinder.dimensions(moved, pressure)

    def length_range(self):
        share, rest = (self.rest_length - self.cone_length) / self.rest_length, self.rest_length
        return tuple(rest + (end - rest) * share for end in self.cylinder.length_range())

    rest_length = property(lambda self: self.cylinder.rest_length)


class Foreign(famjax.AbstractMuscle):
    """F = a P (1 - k eps)^2 - b: somebody else's model, with no geometry at all."""

    rest_length: Float[Array, ""] = famjax.parameters.number("m")
    section: Float[Array, ""] = famjax.parameter("m2", low=0.0, linear=True)
    offset: Float[Array, ""] = famjax.parameter("N", linear=True)
    shape: Float[Array, ""] = famjax.parameter(low=0.5, high=5.0)

    def force(self, length, pressure):
        contraction = 1 - jnp.asarray(length) / self.rest_length
        return self.section * pressure * (1 - self.shape * contraction) ** 2 - self.offset

    def length_range(self):
        return 0.5 * self.rest_length, 1.1 * self.rest_length


@pytest.mark.slow
def test_conical_ends_with_a_parameter_of_their_own(tmp_path):
    truth = ConicalEnds(cylinder(), 0.02)
    data = readings(famjax.Muscle(truth, known_muscle().material, 30e3))
    result = identify(data, geometry=ConicalEnds, parameters={"cone_length": Parameter()})
    assert result.errors.rmse < 1e-5
    assert result.estimate("cone_length").value == pytest.approx(0.02, rel=1e-3)
    fitting.write_fit(result, tmp_path)
    again = fitting.load_fit(tmp_path / "fit.json", own=(__name__,))
    (row,) = fitting.predict(again, np.array([0.27]), np.array([5e5]))
    assert row["force_N"] == pytest.approx(float(result.muscle.force(0.27, 5e5)), rel=1e-12)
    known = fitting.sweep(data, truth, deadband=30e3, orders=(3,))
    assert min(row.rmse for row in known.rows) < 1e-6


def test_a_foreign_model_as_a_peer():
    data = readings(Foreign(0.3, 4e-4, 12.0, 1.7))
    family = ModelFamily.of(Foreign.template(rest_length=0.3), "somebody 2026")
    fit = fitting.comparison.fit_peer(family, data, starts=4)
    assert fit.values == pytest.approx({"section": 4e-4, "offset": 12.0, "shape": 1.7}, rel=1e-6)
    (row,) = fitting.compare(data, [], own=[family], starts=4).rows
    assert row.label == "somebody 2026"
    assert row.lopo_rmse < 1e-6


@pytest.mark.parametrize("path", ["nowhere:Gent", "math:pi", "famjax:Muscle"])
def test_a_law_that_is_not_found_is_refused(path):
    with pytest.raises(InputError, match="law"):
        identify(readings(known_muscle()), law=path)
