import numpy as np
import pytest

from famjax.design.space import costs_of, front_members

RNG = np.random.default_rng(20)


def dominated(costs):
    """By the definition: some other is nowhere worse and somewhere better."""
    nowhere_worse = np.all(costs[:, None] <= costs[None], axis=-1)
    better = np.any(costs[:, None] < costs[None], axis=-1)
    return np.any(nowhere_worse & better, axis=0)


@pytest.mark.parametrize("objectives", [1, 2, 3, 5])
def test_the_front_is_what_the_definition_says(objectives):
    costs = RNG.normal(size=(300, objectives))
    costs[:, 0] = np.round(costs[:, 0], 1)  # with ties
    found = front_members(costs, np.arange(300))
    np.testing.assert_array_equal(found, np.flatnonzero(~dominated(costs)))


def test_of_equal_ones_the_first_is_kept():
    costs = np.array([[1.0, 2.0], [0.0, 3.0], [1.0, 2.0], [1.0, 3.0]])
    assert front_members(costs, np.array([7, 5, 3, 1])).tolist() == [2, 1]


@pytest.mark.parametrize("step", [0.02, 0.3])
def test_a_thinned_front_is_part_of_the_front_and_within_the_step_of_all(step):
    costs = RNG.normal(size=(2000, 3))
    kept = front_members(costs, np.arange(2000), step)
    assert not dominated(costs)[kept].any()
    assert 3 < len(kept) < len(front_members(costs, np.arange(2000)))
    near = np.all(costs[kept][None] <= costs[:, None] + np.log1p(step), axis=-1)
    assert near.any(axis=-1).all()


@pytest.mark.parametrize("step", [0.0, 0.1])
def test_fronts_are_joined_in_any_order(step):
    costs, index = RNG.normal(size=(900, 3)), np.arange(900)
    whole = front_members(costs, index, step)
    kept = np.zeros(0, dtype=np.int64)
    for part in np.array_split(RNG.permutation(900), 7):
        both = np.concatenate([kept, part])
        kept = both[front_members(costs[both], both, step)]
    np.testing.assert_array_equal(kept, whole)


def test_more_of_what_is_to_be_most_costs_less_and_nothing_of_it_the_most():
    columns = {"air": np.array([1.0, 2.0, 0.0]), "force": np.array([1.0, 2.0, 0.0])}
    costs = costs_of(columns, ["air", "force"])
    assert costs[0, 0] < costs[1, 0]
    assert costs[0, 1] > costs[1, 1]
    assert costs[2].tolist() == [-1000, 1000]
    assert front_members(costs, np.arange(3)).tolist() == [0, 1, 2]
