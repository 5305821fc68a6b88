"""Descents in step end where each would end alone, and tapes compute what XLA computes."""

import pickle

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import famjax
from famjax._refuse_if import refuse_if
from fitting import load_bundled
from fitting.comparison import peer_families
from fitting.comparison.fit import posed_peer
from fitting.convex.arrays import member
from fitting.convex.host_qp import solve_host_qps
from fitting.convex.status import Status
from fitting.engine import program
from fitting.engine.descent import descend, descend_many
from fitting.search.multi_start import latin_hypercube
from fitting.search.posing import pose_one
from fitting.trace import tape_store
from fitting.trace.held import with_held
from fitting.trace.tape import OperationTape, UnknownPrimitiveError, record

ROUNDING = 1e-13  # of the largest value: operations in another order
WELL_CONDITIONED = 1e-12  # of the box: parameters that the readings determine


@pytest.fixture(scope="module")
def problem():
    data = load_bundled("DMSP-20-300")
    return posed_peer(peer_families(data)["klute_hannaford"], data)


@pytest.mark.slow
def test_descents_in_step_end_where_each_ends_alone(problem):
    starts = latin_hypercube(3, 10, seed=1)
    whole = np.ones(problem.force.size)
    some = whole.copy()
    some[::5] = 0.0
    problems = [problem.with_readings(factor=f) for f in (whole, some)]
    many = descend_many([p for p in problems for _ in starts], [*starts, *starts])
    alone = [descend(p, start) for p in problems for start in starts]
    for one, other in zip(many, alone, strict=True):
        np.testing.assert_allclose(one.u, other.u, rtol=0, atol=WELL_CONDITIONED)
        assert one.converged
        assert other.converged
        assert one.steps == other.steps


def test_more_descents_than_go_in_step_all_end(problem):
    starts = latin_hypercube(3, 150, seed=2)
    ended: list[int] = []
    ends = descend_many([problem] * 150, list(starts), progress=ended.append)
    assert sorted(ended) == list(range(150))
    best = min(end.cost for end in ends)
    close = [end.u for end in ends if end.cost <= best * (1 + 1e-9)]
    assert len(close) > 75
    np.testing.assert_allclose(np.ptp(close, axis=0), 0, atol=1e-6)


def test_a_stack_of_programmes_has_the_optima_of_each():
    rng = np.random.default_rng(0)
    A, b = rng.standard_normal((20, 9, 3)), rng.standard_normal((20, 9))
    G = np.broadcast_to(np.eye(3), (20, 3, 3))
    h = np.full((20, 3), 0.05)
    A[3, :, 1] = A[3, :, 0]
    A[4, 0, 0] = np.nan
    found = solve_host_qps(A, b, G, h)
    assert {rows.size for rows in found.rows} >= {0, 1, 2}
    for k in range(20):
        here = slice(k, k + 1)
        alone, one = member(solve_host_qps(A[here], b[here], G[here], h[here]), 0), member(found, k)
        assert one.status == alone.status
        np.testing.assert_allclose(one.x, alone.x, rtol=0, atol=ROUNDING)
        np.testing.assert_array_equal(np.sort(one.rows), np.sort(alone.rows))
    assert found.status[3] == Status.RANK_DEFICIENT
    assert found.status[4] == Status.STALLED


def _looped(x: Array, y: Array) -> Array:
    """A loop whose number of rounds differs between the members of a batch."""
    return jax.lax.while_loop(lambda v: v[0] < 40, lambda v: (v[0] * y, v[1] + 1.0), (x[0], y))[1]


FUNCTIONS = {
    "arithmetic": lambda x, y: jnp.tan(x) * y**3 / (1 + x**2) - jnp.sqrt(jnp.abs(x)) ** -1,
    "choice": lambda x, y: jnp.where(x > 0, jnp.exp(x), jnp.log1p(jnp.abs(x)) * y),
    "shapes": lambda x, y: jnp.concatenate([x[::2], jnp.stack([y, y * 2]), x[::-1]]).reshape(-1, 1),
    "products": lambda x, y: (jnp.outer(x, x) + jnp.diag(x)) @ x * y,
    "padding": lambda x, y: jax.lax.pad(x * y, y, ((-1, 2, 1),)),
    "sums": lambda x, y: jnp.cumsum(x)[:, None] + jnp.max(x) + jnp.prod(x) * y,
    "interpolation": lambda x, y: jnp.interp(x, jnp.linspace(-1, 1, 7), jnp.arange(7.0) ** 2) * y,
    "derivative": lambda x, y: jax.jacfwd(lambda v: jnp.sin(v) * v[0])(x) * y,
    "loop": _looped,
    "scan": lambda x, y: jax.lax.scan(lambda c, v: (c * y + v, c), y, x)[1],
    "polynomial": lambda x, y: jnp.polyval(jnp.stack([y, 2 * y, 3.0 - y]), x) * y,
    "inverse functions": lambda x, y: (
        jax.vmap(jax.grad(lambda v: jnp.arcsin(v / 9) + jnp.tanh(v)))(x) * y
    ),
    "sorting": lambda x, y: jnp.sort(jnp.sin(9 * x)) * y,
    "branch": lambda x, y: jax.lax.cond(y > 1.5, jnp.sin, jnp.cos, x),
    "linear solve": lambda x, y: jax.lax.custom_root(
        lambda v: v**3 - y, y, lambda f, v: v - 0.0 * f(v), lambda g, v: v / g(jnp.ones_like(v))
    ),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_tape_computes_what_xla_computes(name):
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0.2, 0.9, (5, 6)), rng.uniform(1.1, 2.0, 5)
    try:
        tape = record(FUNCTIONS[name], x[0], y[0])
    except UnknownPrimitiveError:
        pytest.skip("this JAX traces it to an operation that has no rule, and it is compiled")
    (found,) = tape.run(x.T, y)
    expected = jax.vmap(FUNCTIONS[name])(x, y)
    size = float(jnp.max(jnp.abs(expected)))
    members = np.broadcast_to(found, (*found.shape[:-1], 5))
    np.testing.assert_allclose(np.moveaxis(members, -1, 0), expected, rtol=0, atol=ROUNDING * size)


def test_a_measured_shape_is_done_on_a_tape():
    """With all that its splines take, and the derivative of a fit."""
    lengths, braid = np.array([0.30, 0.27, 0.25, 0.21]), famjax.Braid(0.32, 1.5, 3e-4)
    diameters = 0.02 + 0.2 * (0.30 - lengths[:, None]) * np.sin(np.pi * np.linspace(0, 1, 9))
    x = np.linspace(0, 1, 5)

    def function(length, step):
        shape = famjax.profiles.SampledSurface(lengths, [1e5], diameters[None], braid)
        return jax.jvp(lambda L: shape.diameter(x, L[:, None], 1e5), (length,), (step,))

    at, steps = np.array([0.295, 0.26, 0.215]), np.ones(3)
    for found, expected in zip(
        record(function, at, steps).run(at[:, None], steps[:, None]),
        jax.jit(function)(at, steps),
        strict=True,
    ):
        size = float(jnp.max(jnp.abs(expected)))
        np.testing.assert_allclose(found[..., 0], expected, rtol=0, atol=ROUNDING * size)


@pytest.mark.parametrize("name", ["polynomial", "inverse functions"])
def test_what_jax_0_12_has_operations_of_its_own_for_is_done_on_a_tape(name):
    """The test above skips what has no rule: elastic threads took three times as long by a program."""
    record(FUNCTIONS[name], np.full(6, 0.5), np.array(1.5))


@pytest.mark.parametrize("x", [[1.0, 2.0], [-1.0, 2.0], [-1.0, -2.0]])
def test_a_guard_chooses_alike_whether_or_not_it_is_needed(x):
    def guarded(x):
        inside = x > 0
        return jnp.where(inside, jnp.log(jnp.where(inside, x, 1.0)), jnp.array([3.0, 4.0]))

    tape = record(guarded, np.ones(2))
    for members in (np.array([x, x[::-1]]), np.array([x])):
        (found,) = tape.run(members.T)
        shown = np.broadcast_to(found, (2, len(members))).T
        np.testing.assert_allclose(shown, jax.vmap(guarded)(members), rtol=ROUNDING)


def test_only_what_is_asked_for_is_computed():
    tape = record(lambda x: (jnp.sin(x), jnp.full((), jnp.nan) * jnp.cos(x)), np.ones(3))
    (sine,) = tape.function([0])(np.ones((3, 1)))
    np.testing.assert_allclose(sine[:, 0], np.sin(1.0))


def test_a_derivative_along_a_parameter_takes_what_that_has_an_effect_on():
    def function(x, y, z, t):
        return jax.jvp(lambda a, b: jnp.exp(a) * z + b**3, (x, y), (t[0], t[1]))

    arguments = np.array([0.3, 0.4]), np.array([1.5, 1.7]), np.array([0.0, 2.0])
    tape = record(function, 0.3, 1.5, 2.0, [1.0, 1.0])
    units = [{3: np.array(1.0), 4: np.array(0.0)}, {3: np.array(0.0), 4: np.array(1.0)}]
    both = with_held(tape, {}, units, [0], [1])
    value, along_x, along_y = both.run(*arguments, None, None)
    np.testing.assert_allclose(value, np.exp(arguments[0]) * arguments[2] + arguments[1] ** 3)
    np.testing.assert_allclose(along_x, np.exp(arguments[0]) * arguments[2])
    np.testing.assert_allclose(along_y, 3 * arguments[1] ** 2)
    twice = with_held(tape, {}, [units[0], units[0]], [0], [1])
    assert len(twice.steps) == len(with_held(tape, {}, units[:1], [0], [1]).steps)
    along = with_held(tape, {2: np.array(0.0)}, units[:1], [], [1])
    assert along.outputs[0] in along.constants
    assert not along.run(*arguments, None, None)[0].any()


def test_a_refusal_is_the_same_on_a_tape_and_compiled(folder):
    def function(x):
        return jax.jvp(lambda v: refuse_if(v, v <= 0, "must be positive") ** 2, (x,), (x,))

    tape = record(function, np.ones(3))
    tape_store.save("refusal", tape)
    for one in (tape, tape_store.load("refusal")):
        assert isinstance(one, OperationTape)
        np.testing.assert_allclose(one.run(np.full((3, 1), 2.0))[1], 8.0)
        with pytest.raises(RuntimeError, match="must be positive"):
            one.run(np.array([[1.0, 2.0], [1.0, -1.0], [1.0, 2.0]]))
    for call in (function, eqx.filter_jit(function), jax.vmap(function)):
        np.testing.assert_allclose(call(np.full(3, 2.0))[1], 8.0)
        with pytest.raises(RuntimeError, match="must be positive"):
            call(np.array([1.0, -1.0, 2.0]))


def test_an_operation_without_a_rule_is_named():
    with pytest.raises(UnknownPrimitiveError, match="cholesky"):
        record(jnp.linalg.cholesky, np.eye(3))


@pytest.fixture
def folder(tmp_path):
    tape_store.keep_tapes(tmp_path / "tapes")
    yield tmp_path / "tapes"
    tape_store.keep_tapes(None)


def test_a_kept_tape_computes_the_same(folder):
    tape = record(_looped, np.ones(6), np.ones(()))
    key = tape_store.identity("loop", (6,))
    tape_store.save(key, tape)
    again = tape_store.load(key)
    assert isinstance(again, OperationTape)
    x, y = np.linspace(0.2, 0.9, 30).reshape(6, 5), np.linspace(1.1, 2, 5)
    np.testing.assert_array_equal(again.run(x, y)[0], tape.run(x, y)[0])


def test_a_tape_that_is_damaged_or_another_s_is_recorded_anew(folder):
    tape = record(_looped, np.ones(6), np.ones(()))
    key, other = tape_store.identity("loop", (6,)), tape_store.identity("another")
    tape_store.save(key, tape)
    file = folder / f"{key}.json"
    whole = file.read_text()
    (folder / f"{other}.json").write_text(whole)
    assert tape_store.load(other) is None
    for damaged in (whole[:-40], whole.replace("1.0", "1.001", 1), whole.partition("\n")[2], ""):
        file.write_text(damaged)
        assert tape_store.load(key) is None
    assert not list(folder.glob("*.part"))


def test_a_problem_that_was_sent_has_the_same_bits_and_keeps_its_tape(folder):
    problem = pose_one(load_bundled("DMSP-10-250")).problem
    packed = pickle.dumps(problem)
    tape_store.keep_tapes(None)
    sent = pickle.loads(packed)
    tape_store.keep_tapes(folder)  # which a worker learns after it has unpacked its work
    program._traced.cache_clear()  # a worker has traced nothing yet
    start = latin_hypercube(3, 1, seed=4)[0]
    here, there = descend(problem, start), descend(sent, start)
    np.testing.assert_array_equal(here.point.residual, there.point.residual)
    np.testing.assert_array_equal(here.u, there.u)
    assert [file.suffix for file in folder.iterdir()] == [".json"]
    stations = problem.parts[0].inputs.stations
    moved = pickle.loads(pickle.dumps(problem.parts[0].with_stations(0.9 * stations)))
    np.testing.assert_array_equal(moved.program._arrays[-1], 0.9 * stations)


def test_a_broken_file_is_as_good_as_none(folder):
    key = tape_store.identity("broken")
    tape_store.save(key, record(jnp.sin, np.ones(3)))
    next(folder.iterdir()).write_text('{"steps": [')
    assert tape_store.load(key) is None


def test_a_function_of_ones_own_has_no_identity(folder):
    assert tape_store.identity(lambda x: x) is None
    assert tape_store.identity(1.0) != tape_store.identity(2.0)


def test_families_of_the_registry_have_identities_of_their_own(folder):
    data = load_bundled("DMSP-20-300")
    keys = [
        tape_store.identity(posed_peer(family, data).parts[0].family.identity)
        for family in peer_families(data).values()
    ]
    assert None not in keys
    assert len(set(keys)) == len(keys)
