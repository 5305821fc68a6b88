"""What holds for every formula, shape, law, braid, geometry, term and muscle alike.

A new class is one line in a table of `tests/muscles.py` or of this file.
"""

import inspect
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import muscles as known
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

import famjax
from famjax import braids, geometries, surfaces, terms
from famjax.control import Antagonist, pressure_for_force
from famjax.design import Combination
from famjax.measured import AverageDiameterGeometry, MeasuredGeometry, Meridian
from famjax.muscle import give_way
from famjax.profiles import FourierProfile
from famjax.slip import MaxwellSlip, SlipElements

EXACT = 1e-11  # of the largest: roundings, in another order
DIFFERENCE = 2e-6  # of the largest: central differences
SINGLE = 2e-5  # of the largest: float32
STEP = 1e-6  # of central differences, in parts of each number
SECOND_STEP = 1e-5


class Case(NamedTuple):
    """A result of a model and of three states: every number of both is moved."""

    call: Callable[..., jax.Array]
    model: Any  # or a function that makes it; None for a formula
    states: tuple[np.ndarray, ...]  # (3,) each, which broadcast against each other
    single: float = SINGLE
    difference: float = DIFFERENCE
    second: bool = False  # second derivatives too

    def made(self) -> Any:
        return self.model() if inspect.isfunction(self.model) else self.model


# ---- formulas, with the dimensions (length, pressure) of their arguments and of their result

LENGTH, VOLUME, PRESSURE, NUMBER, FORCE = (1, 0), (3, 0), (0, 1), (0, 0), (2, 1)
HOOP = (PRESSURE, LENGTH, LENGTH, LENGTH, NUMBER)

FORMULAS: dict[str, tuple[Callable, tuple, tuple, tuple[int, int]]] = {
    function.__name__: (function, arguments, dimensions, result)
    for function, arguments, dimensions, result in [
        (braids.thread_length_from_angle, (0.3, 1.1), (LENGTH, NUMBER), LENGTH),
        (braids.turns_from_angle, (0.3, 0.02, 1.1), (LENGTH, LENGTH, NUMBER), NUMBER),
        (braids.diameter_from_length, (0.3, 0.34, 2.1), (LENGTH, LENGTH, NUMBER), LENGTH),
        (braids.braid_angle_from_length, (0.3, 0.34), (LENGTH, LENGTH), NUMBER),
        (braids.braid_angle_from_diameter, (0.03, 0.02, 1.1), (LENGTH, LENGTH, NUMBER), NUMBER),
        (braids.force_magnification, (1.1,), (NUMBER,), NUMBER),
        (braids.gaylord_force, (5e5, 0.01, 1.1), (PRESSURE, LENGTH, NUMBER), FORCE),
        (geometries.bladder_thickness, (0.3, 0.01, 4e-5), (LENGTH, LENGTH, VOLUME), LENGTH),
        (terms.bladder_axial_force, (-1e6, 4e-5, 0.3), (PRESSURE, VOLUME, LENGTH), FORCE),
        (terms.bladder_hoop_force, (1e6, 2e-3, 0.3, 0.01, 2.1), HOOP, FORCE),
    ]
}


def formula_cases() -> Iterator[tuple[str, Case]]:
    for name, (function, arguments, *_) in FORMULAS.items():
        states = tuple(np.array([0.99, 1.0, 1.01]) * value for value in arguments)
        call = lambda _, *states, function=function: function(*states)  # noqa: E731
        yield name, Case(call, None, states, second=True)
    states = (np.array([0.03, 0.5, 60.0]), np.full(3, 1.8e-5), np.full(3, 0.5))
    yield "give_way", Case(lambda _, *states: give_way(*states), None, states, second=True)


# ---- shapes

FOURIER = FourierProfile(1.27, [-0.83, 0.29, 0.18], [1.20, 0.75, 0.04], 4.347)
WIDE = np.multiply.outer([1.0, 1.3, 1.6, 1.9], [0.9, 1.0, 0.95, 1.0, 0.9])  # by length and station
FAMILIES: dict[str, Callable[[], surfaces.AbstractMeasuredFamily]] = {
    "measured": lambda: known.two_profiles(known.INELASTIC),
    "measured, elastic": lambda: known.two_profiles(known.KEVLAR),
    "sampled": lambda: surfaces.SampledSurface(
        [9.2, 8.0, 7.0, 6.0], [20.0, 100.0], np.multiply.outer([1.0, 1.02], WIDE), known.INELASTIC
    ),
}


def diameter(family: surfaces.AbstractMeasuredFamily, *at: jax.Array) -> jax.Array:
    return family.diameter(*at)


def measures(profile: FourierProfile, length: jax.Array) -> jax.Array:
    line = Meridian.of(profile.diameter, length)
    return jnp.stack([line.mean_diameter, line.arc_length, line.surface_area, line.volume], -1)


def shape_cases() -> Iterator[tuple[str, Case]]:
    x, length = np.array([0.07, 0.3, 0.9]), np.array([5.0, 6.0, 7.0])
    pressure = np.array([60.0, 80.0, 30.0])
    yield "fourier shape", Case(FourierProfile.diameter, FOURIER, (x, length), second=True)
    for name, family in FAMILIES.items():
        at = (x, np.array([7.0, 7.6, 9.0]), pressure)
        yield f"{name} family", Case(diameter, family, at)
    yield "fourier measures", Case(measures, FOURIER, (length[:2],), 1e-4)


# ---- threads, braids, laws, geometries, terms

BRAIDS = {
    "inelastic": known.INELASTIC,
    "elastic": known.KEVLAR,
    "toe": braids.ElasticBraid(known.B0, known.N, 0.011, 144, known.TOE),
    "compliant": braids.CompliantBraid.of(known.INELASTIC, 4e-6),
}
LENGTHS, PRESSURES = known.L0 * np.array([0.99, 0.8, 0.9]), np.array([60.0, 80.0, 30.0])
BY_STATE = (LENGTHS, PRESSURES)


def force(muscle: famjax.AbstractMuscle, length: jax.Array, pressure: jax.Array) -> jax.Array:
    return muscle.force(length, pressure)


def stresses(law: famjax.materials.AbstractMaterial, axial, hoop, pressure) -> jax.Array:
    return jnp.stack(jnp.broadcast_arrays(*law.stresses(axial, hoop, pressure)), -1)


def part_cases() -> Iterator[tuple[str, Case]]:
    tension, strain = np.array([-1e-4, 0.3, 20.0]), np.array([1e-4, 4e-3, 2e-2])
    for name, thread in known.THREADS.items():
        yield f"strain of {name} thread", Case(type(thread).strain, thread, (tension,))
        yield f"tension of {name} thread", Case(type(thread).tension, thread, (strain,), 2e-4)
    for name, braid in BRAIDS.items():
        yield f"{name} braid", Case(type(braid).thread_length, braid, BY_STATE, 3e-7)
    strains = (np.array([-0.21, -0.06, 0.1]), np.array([0.9, 1.6, 0.1]), np.array([0.6, 1.5, 1.1]))
    for name, law in known.LAWS.items():
        yield f"{name} law", Case(stresses, law, strains)
    for name, of in known.GEOMETRIES.items():
        pull = terms.PressurisedBraid(3.0) + terms.BladderWall(known.LATEX)
        make = lambda of=of, pull=pull: famjax.Muscle(of(), pull)  # noqa: E731
        yield f"{name} geometry", Case(force, make, BY_STATE)
    for name, term in known.TERMS.items():
        braid = known.KEVLAR if "virtual" in name else known.INELASTIC
        muscle = famjax.Muscle(famjax.EstimatedGeometry(braid, known.SPECIMEN), term)
        yield f"{name} term", Case(force, muscle, BY_STATE)
    for cls in (MeasuredGeometry, AverageDiameterGeometry):
        make = lambda cls=cls: famjax.Muscle(  # noqa: E731
            cls(known.measured_family(known.KEVLAR), known.SPECIMEN), known.LATEX
        )
        yield f"table 4.3 as {cls.__name__}", Case(force, make, BY_STATE, 1e-4)


# ---- muscles

APART = famjax.take_apart(known.FESTO, ("braid_diameter", "braid_angle", "E_1", "E_2"))


def cut(muscle: famjax.Muscle, rest: jax.Array) -> jax.Array:
    """The force of one length after the other, each that of a muscle of its own."""
    one = lambda rest: famjax.cut_to_length(muscle, rest).force(0.9 * rest, 4e5)  # noqa: E731
    return jnp.vectorize(one)(rest)


def with_others(muscle: famjax.Muscle, *values: jax.Array) -> jax.Array:
    def one(*values: jax.Array) -> jax.Array:
        named = dict(zip(("braid_diameter", "braid_angle", "E_2"), values, strict=True))
        return muscle.with_parameters(named).force(0.27, 4e5)

    return jnp.vectorize(one)(*values)


def together(_: None, part: jax.Array) -> jax.Array:
    return jnp.vectorize(lambda k: APART.muscle(k * APART.scaled).force(0.27, 4e5))(part)


def in_joint(pair: Antagonist, angle: jax.Array, torque: jax.Array) -> jax.Array:
    """Bounds of the stiffness, and the pressures for the middle of it."""
    low, high = (pair.pressures_for(angle, far, torque).stiffness for far in (-1e9, 1e9))
    found = pair.pressures_for(angle, 0.5 * (low + high), torque)
    every = jnp.broadcast_arrays(low, high, found.flexor, found.extensor)
    return jnp.stack(every, -1) / jnp.array([1e2, 1e2, 1e5, 1e5])


RANDOM = np.random.default_rng(0)
RIG = famjax.MountedMuscle(known.FESTO, 5e-6)
SOLVES: dict[str, tuple[Callable, tuple[float, ...]]] = {
    "stiffness": (famjax.Muscle.stiffness, (0.26, 4e5)),
    "volume": (famjax.Muscle.volume, (0.26, 4e5)),
    "length at a load": (lambda m, F, P: m.length_at_load(F, P), (300.0, 4e5)),
    "free contraction": (lambda m, P: m.free_contraction(P), (4e5,)),
    "onset pressure": (lambda m, L, top: m.onset_pressure(L, top), (0.26, 2e6)),
    "path modulus": (
        lambda m, L, P: famjax.path_modulus(m.material, m.geometry, L, P), (0.26, 4e5)
    ),
    "cut to length": (cut, (0.1,)),
    "other parameters": (with_others, (0.023, 1.08, -1.9e7)),
}  # fmt: skip


def muscle_cases() -> Iterator[tuple[str, Case]]:
    L, P = known.REST * np.array([0.82, 0.93, 0.999]), np.array([1.5e5, 3.5e5, 6e5])
    for name, muscle in known.MUSCLES.items():
        yield name, Case(force, muscle, (L, P), 2e-3)  # differences of large terms
    yield "festo", Case(force, known.FESTO, (1.18 * L, P), 2e-4, second=True)
    yield "chambers", Case(force, known.CHAMBERS, BY_STATE, second=True)
    parts = np.array([0.97, 1.0, 1.03])
    for name, (call, arguments) in SOLVES.items():
        states = tuple(parts * value for value in arguments)
        yield f"{name} of festo", Case(call, known.FESTO, states, 2e-4)
    yield "taken apart", Case(together, None, (parts,), 2e-4)
    elastic = lambda: famjax.Muscle(known.GEOMETRIES["toe"](), known.LATEX)  # noqa: E731
    for name in ("stiffness", "free contraction"):
        states = BY_STATE if name == "stiffness" else (np.array([60.0, 80.0, 100.0]),)
        yield f"{name} of an elastic muscle", Case(SOLVES[name][0], elastic, states, 2e-4)
    elements = SlipElements([0.004, 0.02, 0.07], [3.0, 2.0, 6.0])
    slips = MaxwellSlip(elements, SlipElements([0.002, 0.015], [8.0, 20.0]), 0.3, 1e6)
    states = (0.3 * (1 - 0.2 * RANDOM.uniform(size=9)), 8e5 * RANDOM.uniform(size=9))
    sleeve = Combination(*known.DESIGN)
    states = np.array([0.05, 0.2, 0.1]), PRESSURES
    latex = lambda one, e, P: one.force(e, P)  # noqa: E731
    yield "design of latex", Case(latex, sleeve, states, 2e-4)
    yield "history of slips", Case(MaxwellSlip.along, slips, states, 1e-3)
    shaped = lambda: famjax.EquilibriumMuscle(  # noqa: E731
        known.INELASTIC, known.SPECIMEN, known.LATEX, end_diameter=0.863
    )
    yield "equilibrium", Case(force, shaped, BY_STATE, 2e-4)
    load = lambda m, P: famjax.work_budget(m, P, known.L0, 0.7 * known.L0).load  # noqa: E731
    yield "load of a stroke", Case(load, known.CHAMBERS, (PRESSURES,), 2e-4)
    paths = tuple(known.Lever([s * 0.03, 0.0], [s * 0.01, -0.3], 0.025) for s in (-1, 1))
    pair = Antagonist(known.FESTO, known.FESTO, paths, (0.0, 6e5))
    angles = np.array([0.2, -0.1, 0.3])
    for name, call, states in (
        ("pressure for a force", lambda m, F, L: pressure_for_force(m, F, L, (0.0, 6e5)).pressure,
         (np.array([400.0, 200.0, 300.0]), np.array([0.27, 0.275, 0.267]))),
        ("pressures of a joint", in_joint, (angles, np.array([1.0, 0.0, 0.5]))),
    ):  # fmt: skip
        yield name, Case(call, known.FESTO if name == "pressure for a force" else pair, states)
    yield "stiffness in a rig", Case(famjax.MountedMuscle.stiffness, RIG, (1.18 * L, P), 2e-3)
    yield "free contraction in a rig", Case(SOLVES["free contraction"][0], RIG, (P,), 2e-4)


CASES = dict([*formula_cases(), *shape_cases(), *part_cases(), *muscle_cases()])
SLOW = (
    "measured", "sampled", "average", "toe geometry", "table 4.3", "at thread length",
    "virtual work term", " in a rig", "onset", "path modulus",
    "toe braid at", "elastic muscle", "ogden", "at a load", "free contraction", "mounted by a power",
    "embedded geometry", " of a joint", "pressure for a force",
)  # fmt: skip
EVERY = [
    pytest.param(case, id=name, marks=[pytest.mark.slow] * any(word in name for word in SLOW))
    for name, case in CASES.items()
]


@pytest.mark.parametrize("case", [one for one in EVERY if "history" not in str(one.id)])
def test_jit_vmap_and_broadcasting_equal_a_loop(case):
    call, model, states = case.call, case.made(), case.states

    @eqx.filter_jit
    def compiled(model: Any, states: tuple) -> tuple[jax.Array, ...]:
        grid = call(model, states[0][:, None], *states[1:])
        return call(model, *states), jax.vmap(lambda *at: call(model, *at))(*states), grid

    one = eqx.filter_jit(call)
    loop = np.array([one(model, *map(np.asarray, at)) for at in zip(*states, strict=True)])
    jitted, mapped, grid = (np.asarray(one) for one in compiled(model, states))
    if len(states) > 1:
        grid = grid[range(3), range(3)]
    every = (call(model, *states), jitted, mapped, np.reshape(grid, loop.shape))
    assert np.isfinite(loop).all()
    for found in every:
        np.testing.assert_allclose(found, loop, rtol=EXACT, atol=EXACT * np.abs(loop).max())


@pytest.mark.parametrize("case", EVERY)
def test_derivatives_are_differences(case):
    """Forward and reverse, in every number of the model and of the states, in parts of its size."""
    arrays, rest = eqx.partition((case.made(), case.states), eqx.is_inexact_array)
    numbers, remade = ravel_pytree(jax.tree.map(jnp.asarray, arrays))

    def of(parts: jax.Array) -> jax.Array:
        model, states = eqx.combine(remade(numbers * parts), rest)
        return case.call(model, *states)

    ones = np.ones(numbers.size)
    steps = STEP * np.eye(numbers.size)
    way = np.random.default_rng(0).normal(size=numbers.size)

    @jax.jit  # one program
    def slopes(moved: jax.Array, bent: jax.Array) -> tuple:
        reverse = jax.jacrev(of)
        second = (jax.jvp(reverse, (ones,), (way,))[1], jax.lax.map(reverse, bent))
        both = jax.jacfwd(of)(ones), reverse(ones)
        return *both, jax.lax.map(of, moved), second if case.second else ()

    bent = np.stack([ones + SECOND_STEP * way, ones - SECOND_STEP * way])
    forward, backward, moved, second = slopes(np.concatenate([ones + steps, ones - steps]), bent)
    up, down = np.split(np.asarray(moved), 2)
    difference = np.moveaxis((up - down) / (2 * STEP), 0, -1)
    largest = np.abs(difference).max()
    assert largest > 0
    for found in (forward, backward):
        np.testing.assert_allclose(found, difference, atol=case.difference * largest)
    if case.second:
        rate, (up, down) = (np.asarray(one) for one in second)
        difference = (up - down) / (2 * SECOND_STEP)
        np.testing.assert_allclose(rate, difference, atol=DIFFERENCE * np.abs(rate).max())


# The muscle that was taken apart, and limits of pressures are of float64.
DOUBLE = ("taken apart", "pressure for a force", "pressures of a joint")


@pytest.mark.parametrize("case", [one for one in EVERY if one.id not in DOUBLE])
def test_float32_stays_float32(case):
    whole = case.made()
    single, others = eqx.partition((whole, case.states), eqx.is_inexact_array)
    single = jax.tree.map(lambda x: x.astype(np.float32), single)
    model, states = eqx.combine(single, others)
    found = eqx.filter_jit(case.call)(model, *states)
    assert found.dtype == jnp.float32
    exact = np.asarray(case.call(whole, *case.states))
    size = np.abs(exact).max()
    np.testing.assert_allclose(found / size, exact / size, atol=case.single)


@pytest.mark.parametrize("name", FORMULAS)
def test_a_formula_holds_in_any_units(name):
    function, arguments, dimensions, result = FORMULAS[name]
    inch, psi = 1 / 0.0254, 1 / 6894.757
    powers = [inch**i * psi**j for i, j in (*dimensions, result)]
    other = [value * power for value, power in zip(arguments, powers[:-1], strict=True)]
    np.testing.assert_allclose(function(*other), function(*arguments) * powers[-1], rtol=1e-13)


WITH_TESTS_OF_THEIR_OWN = {
    "cylinder_dimensions", "strain_under_line", "thread_tension", "wall_forces"
}  # fmt: skip


def test_every_public_function_is_in_the_table():
    public = {
        name
        for module in (braids, geometries, terms)
        for name, value in vars(module).items()
        if getattr(value, "__module__", None) == module.__name__ and name[0].islower()
    }
    assert public == set(FORMULAS) | WITH_TESTS_OF_THEIR_OWN
