"""Writes the golden files of the present version: `python tests/famjax/cards/make_golden.py`.

Run once for each new schema, before it is released. What lies in `golden` of an earlier version is
never written again: it is what that version wrote.
"""

import json
from pathlib import Path

import jax
import numpy as np

import famjax
from famjax.cards import Covariance, MuscleCard, Provenance, draw, read_card, schema, write_card
from famjax.continuation import Region
from famjax.muscle import MountedMuscle, flatten
from famjax.slip import CentredSlip, MaxwellSlip, ReferenceCycle, SlipElements

GOLDEN = Path(__file__).parent / "golden"
LENGTHS, PRESSURES = [0.15, 0.24, 0.27, 0.3, 0.33], [2e4, 2e5, 5e5, 9e5]


def golden_card() -> MuscleCard:
    """All that a card can hold: two models, errors, sample, hysteresis."""
    braid = famjax.Braid.from_rest(diameter=0.022, braid_angle=1.1, length=0.3)
    shape = famjax.EstimatedGeometry(braid, famjax.Bladder(0.3, 0.02, 0.0018, embedded=True))
    first = famjax.Muscle(shape, famjax.PolynomialMaterial([6e5, 2e5, 1e5]), 4e4)
    ends = famjax.geometries.EndEffectGeometry(shape, 1.05)
    second = famjax.Muscle(ends, famjax.materials.NeoHookeanMaterial(2e5), 3.5e4)
    members = MountedMuscle(first, 0.0), MountedMuscle(second, 0.0)
    slip = MaxwellSlip(
        SlipElements([0.004], [8.0]), SlipElements([0.002, 0.01], [10.0, 40.0]), 0.3, 1e6
    )
    region = Region([0.24, 0.3], [5e4, 6e5])
    weights = np.array([0.5, 0.5])
    flat = np.asarray(flatten(members[0])[0])
    directions = np.diag(0.01 * flat)[flat > 1e4]  # coefficients and deadband, each by 1 %
    return MuscleCard(
        "golden", members, weights, region,
        Covariance(["deadband_pressure"], ["Pa"], [4e4], [4e4], [[1e-4]]),
        draw(members, weights, directions, region, seed=7, count=3),
        CentredSlip(slip, ReferenceCycle("ramp", 0.0, 6e5, True)),
        Provenance(verdict="identified", rmse_N=1.5, source="made up", date="2026-11-22"),
    )  # fmt: skip


def answers(card: MuscleCard) -> dict[str, list]:
    """What the muscle of a card says at a few states, in the data and beyond."""
    L, P = (one.ravel() for one in np.meshgrid(LENGTHS, PRESSURES))
    safe = card.safe()
    state = safe.start(0.27, 0.0)
    return {
        "force_N": np.asarray(safe.force(L, P)).tolist(),
        "stiffness_N_per_m": np.asarray(safe.stiffness(L, P)).tolist(),
        "volume_m3": np.asarray(card.volume(L, P)).tolist(),
        "pull_N": float(safe.pull(state, 0.26, 3e5)),
    }


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    version = schema()["$id"].removeprefix("famjax-").replace("/", "-")
    path = write_card(golden_card(), GOLDEN / f"{version}.json")
    expected = path.with_suffix(".expected.json")
    expected.write_text(json.dumps(answers(read_card(path)), indent=1) + "\n")
