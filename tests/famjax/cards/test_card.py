"""Muscle cards: every class as plain data and back, to the file and back, what is damaged."""

import dataclasses
import functools
import inspect
import json
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import muscles as known
import numpy as np
import pytest
from maps import cylinder
from slow_cases import slow_after

import famjax
from famjax.boundary.errors import InputError
from famjax.cards import MuscleCard, muscle_as_dict, muscle_from_dict, read_card, schema, write_card
from famjax.continuation import Region
from famjax.muscle import MountedMuscle
from famjax.muscles import bundled_card

GOLDEN = Path(__file__).parent / "golden"
"""What each version wrote is never written again; of a new one, what it writes of a card read here."""
RELOADED = 1e-12


@pytest.fixture(scope="module")
def golden() -> MuscleCard:
    return read_card(GOLDEN / "card-1.json")


def answers(card: MuscleCard) -> dict[str, list]:
    """What the muscle of a card says at a few states, in the data and beyond."""
    L, P = np.meshgrid([0.15, 0.24, 0.27, 0.3, 0.33], [2e4, 2e5, 5e5, 9e5])
    L, P, safe = L.ravel(), P.ravel(), card.safe()
    return {
        "force_N": np.asarray(safe.force(L, P)),
        "stiffness_N_per_m": np.asarray(safe.stiffness(L, P)),
        "volume_m3": np.asarray(card.volume(L, P)),
        "pull_N": float(safe.pull(safe.start(0.27, 0.0), 0.26, 3e5)),
    }


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(GOLDEN.glob("*.expected.json")), ids=lambda path: path.name)
def test_a_card_of_every_version_is_read_and_says_the_same(path):
    card = read_card(path.with_name(path.name.replace(".expected", "")))
    wanted = json.loads(path.read_text())
    found = answers(card)
    for name, values in wanted.items():
        atol = 1e-9 * np.abs(values).max()  # nested derivatives by another compiler
        np.testing.assert_allclose(found[name], values, rtol=0, atol=atol)


def test_a_card_comes_back_to_the_last_digit(golden, tmp_path):
    path = write_card(golden, tmp_path / "new" / "card.json")
    again = read_card(path)
    assert path.read_text() == write_card(again, tmp_path / "card.json").read_text()
    L, P = np.array([0.2, 0.26, 0.29, 0.36]), np.array([1e5, 3e5, 8e5, 2e5])
    np.testing.assert_allclose(again.safe().force(L, P), golden.safe().force(L, P), rtol=RELOADED)
    np.testing.assert_allclose(again.volume(L, P), golden.volume(L, P), rtol=RELOADED)
    assert again.covariance == golden.covariance
    assert again.provenance == golden.provenance
    assert again.draws == golden.draws
    assert eqx.tree_equal(again.hysteresis, golden.hysteresis)
    assert eqx.tree_equal(again.members, golden.members)


def test_the_schema_file_is_that_of_the_classes():
    file = Path(famjax.cards.__file__).parent / "muscle_card.schema.json"
    assert file.read_text() == json.dumps(schema(), indent=1) + "\n"


MEMBER = "members.0.muscle"


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("schema", "famjax-card/99", "not a muscle card of schema famjax-card/1, .*'famjax-card/99'"),
        ("schema", ..., "required field `schema`; create a card with famjax card"),
        ("members", [], "length >= 1"),
        ("members.0.weight", "half", r"Expected `float`.*\$.members\[0\].weight"),
        ("members.0.weight", float("nan"), "or is damaged: JSON is malformed"),
        (f"{MEMBER}.geometry.type", "Balloon",
         "muscle.geometry .* unknown type 'Balloon'; use one of .*EstimatedGeometry"),
        (f"{MEMBER}.geometry.type", "Braid", "unknown type 'Braid'"),
        (f"{MEMBER}.geometry.braid.type", "LinearThread", "use one of Braid, Compl"),
        (f"{MEMBER}.geometry.braid.turns", ..., "no entry 'turns' in .*muscle.geometry.braid"),
        (f"{MEMBER}.geometry.bladder.embedded", 1, "embedded .* must be of type bool, got 1"),
        (f"{MEMBER}.geometry.bladder", [], "must be a JSON object in braces"),
        (f"{MEMBER}.material.type", ..., "muscle.material .* unknown type None; .*Polynom"),
        (f"{MEMBER}.material.coefficients_psi", [1.0], "unknown entry 'coefficients_psi'"),
        (f"{MEMBER}.material.coefficients_Pa", 1.0, r"must be an array of shape \(order\), got"),
        (f"{MEMBER}.material.coefficients_Pa", [1.0, "x"], "material.coefficients .* finite num"),
        (f"{MEMBER}.material.coefficients_Pa", [[1.0], [1.0, 2.0]], "must contain only finite numbers"),
        (f"{MEMBER}.material.coefficients_Pa", [1.0, None], "must contain only finite numbers"),
        ("data.length_m", [0.1], "length >= 2.*data.length_m"),
        ("colour", "blue", "unknown field `colour`"),
        ("sample.rows", [[1.0]], "the sample must have the parameters"),
        ("sample.numbers", [f"n{k}" for k in range(11)], "the sample must have the parameters"),
        ("hysteresis.cycle.turn_Pa", ..., "required field `turn_Pa`.*cycle"),
    ],
)  # fmt: skip
def test_a_damaged_card_is_explained(path, value, message, tmp_path):
    document = json.loads((GOLDEN / "card-1.json").read_text())
    at, (*places, key) = document, path.split(".")
    for place in places:
        at = at[int(place) if isinstance(at, list) else place]
    if value is ...:
        del at[key]
    else:
        at[key] = value
    (tmp_path / "card.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=message):
        read_card(tmp_path / "card.json")


@pytest.mark.slow
def test_the_volume_is_that_of_virtual_work_and_goes_on_beyond_the_data():
    """A braid without wall and deadband pulls with -P dV/dL, rounded ends too."""
    geometry = famjax.geometries.EndEffectGeometry(cylinder(), 1.1)
    muscle = famjax.Muscle(geometry, famjax.terms.PressurisedBraid(0.0))
    slope = jax.grad(lambda L: geometry.inner_volume(L, 3e5))(0.27)
    np.testing.assert_allclose(-3e5 * slope, muscle.force(0.27, 3e5), rtol=1e-12)
    region = Region([0.25, 0.3], [1e5, 5e5])
    card = MuscleCard("plain", (MountedMuscle(muscle, 0.0),), np.ones(1), region)
    L = np.linspace(0.0, 0.6, 601)
    V = np.asarray(card.volume(L, 3e5))
    assert (V > 0).all()
    assert (np.diff(V) < 0).all()
    sides = np.array([0.25 - 1e-9, 0.25 + 1e-9, 0.3 - 1e-9, 0.3 + 1e-9])
    rates = jax.vmap(jax.grad(lambda L: card.volume(L, 3e5)))(sides)
    np.testing.assert_allclose(rates[::2], rates[1::2], rtol=1e-6)
    wall = famjax.Bladder(0.2, 0.01, 1.8e-3, embedded=True)  # mid-wall 5 mm: bore 8.2 mm
    assert float(wall.volume_within_braid) == pytest.approx(np.pi * 0.2 * (5e-3**2 - 4.1e-3**2))


@pytest.mark.slow
def test_a_cut_card_pulls_the_same_at_the_same_contraction():
    card = bundled_card("DMSP-10")
    rest = float(card.muscle.geometry.rest_length)
    short = card.cut(rest / 2)
    assert f"cut from {rest:.6g} to {rest / 2:.6g} m" in short.provenance.notes
    assert short.draws is None
    # The dead length of its ends stays: without them it contracts alike, and beyond its region too.
    (one,) = card.members
    cylinder = eqx.tree_at(lambda m: m.muscle.geometry, one, one.muscle.geometry.cylinder)
    whole = dataclasses.replace(card, members=(cylinder,))
    for contraction, pressure in ((0.0, 3e5), (0.1, 5e5), (0.35, 6e5), (-0.2, 9e5)):
        pairs = (whole.cut(rest / 2), rest / 2), (whole, rest)
        found, wanted = (of.safe().force((1 - contraction) * L0, pressure) for of, L0 in pairs)
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-6)
    with pytest.raises(InputError, match="rest length must be > 0"):
        card.cut(-1.0)
    document = famjax.cards.card_as_document(short)
    assert famjax.cards.card_from_document(document).name == "DMSP-10"


P = 1.5
PROFILES = [known.TABLE_4_3[at][0].symmetrised() for at in (0.0, 0.0875, 0.175, 0.2625)]


# A family is made where a test needs it: making it compiles, and every worker collects this file.
def family() -> famjax.surfaces.MeasuredFamily:
    lengths = known.L0 * np.linspace(1.0, 0.73, len(PROFILES))
    return famjax.surfaces.MeasuredFamily(lengths, PROFILES, 100.0, known.KEVLAR, margin=0.01)


def surface() -> famjax.surfaces.SampledSurface:
    x, lengths = np.linspace(0, 1, 9), known.L0 * np.array([1.0, 0.86, 0.72])
    bulge = 1 + 0.3 * np.arange(3)[:, None] * np.sin(np.pi * x)
    wide = np.stack([bulge, 1.01 * bulge])
    return famjax.surfaces.SampledSurface(lengths, [20.0, 90.0], wide, known.KEVLAR, 0.02)


GEOMETRIES: dict[str, Callable[[], famjax.geometries.AbstractGeometry]] = {
    **known.GEOMETRIES,
    "photographed": lambda: famjax.MeasuredGeometry(surface(), known.SPECIMEN, 8),
    "average": lambda: famjax.measured.AverageDiameterGeometry(family(), known.SPECIMEN),
}
SUMS_OF_TERMS = {"terms": famjax.Muscle(known.CYLINDER, [*known.TERMS.values()])}
MUSCLES = [*GEOMETRIES, *known.LAWS, *SUMS_OF_TERMS]
BASES = (
    famjax.geometries.AbstractGeometry, famjax.materials.AbstractMaterial,
    famjax.braids.AbstractBraid, famjax.braids.AbstractThread, famjax.profiles.AbstractProfile,
    famjax.surfaces.AbstractMeasuredFamily, famjax.terms.AbstractForceTerm, famjax.Bladder,
    famjax.Muscle,
)  # fmt: skip
ROOMS = ("braids", "geometries", "materials", "measured", "muscle", "continuation", "profiles",
         "surfaces", "slip", "terms")  # fmt: skip
CONCRETE = [
    cls
    for room in (getattr(famjax, name) for name in ROOMS)
    for cls in vars(room).values()
    if inspect.isclass(cls)
    and cls.__module__ == room.__name__
    and issubclass(cls, BASES)
    and not inspect.isabstract(cls)
    and cls is not famjax.terms.SumOfTerms
]


@functools.cache
def muscle_named(name: str) -> famjax.Muscle:
    if name in GEOMETRIES:
        return famjax.Muscle(GEOMETRIES[name](), known.LATEX, 0.1)
    if name in known.LAWS:
        return famjax.Muscle(known.CYLINDER, known.LAWS[name], 1 / 3)
    return SUMS_OF_TERMS[name]


@eqx.filter_jit
def force(muscle: famjax.Muscle) -> jax.Array:
    return muscle.force(known.L0 * np.array([0.99, 0.8]), P)


LAST = sorted(MUSCLES, key=lambda one: one in ("photographed", "average"))


@pytest.mark.parametrize("name", slow_after(len(MUSCLES) - 2, LAST))
def test_a_muscle_comes_back_to_the_last_bit(name, caplog):
    muscle = muscle_named(name)
    pull = force(muscle)
    assert np.isfinite(pull).all()
    card = json.loads(json.dumps(muscle_as_dict(muscle), allow_nan=False))
    again = muscle_from_dict(card)
    with jax.log_compiles():  # what was written in Python's numbers meets the same programs
        np.testing.assert_array_equal(force(again), pull)
    assert not caplog.records, caplog.records[0].getMessage()
    assert jax.tree.structure(again) == jax.tree.structure(muscle)
    for mine, theirs in zip(jax.tree.leaves(again), jax.tree.leaves(muscle), strict=True):
        np.testing.assert_array_equal(mine, theirs)
        assert mine.dtype == theirs.dtype


def test_every_part_of_a_muscle_has_a_card_and_is_tried_above():
    tried: set[str] = set()

    def walk(card: object) -> None:
        if isinstance(card, dict):
            tried.add(card["type"])
        for value in card.values() if isinstance(card, dict) else card:
            if isinstance(value, dict | list):
                walk(value)

    for name in MUSCLES:
        walk(muscle_as_dict(muscle_named(name)))
    assert tried == {cls.__name__ for cls in CONCRETE}


class Undeclared(famjax.PolynomialMaterial):
    """Its modulus says no unit."""

    modulus: np.ndarray = eqx.field(default_factory=lambda: np.ones(2))


def test_what_has_no_card_is_refused():
    class Local(famjax.PolynomialMaterial):
        pass

    with pytest.raises(InputError, match=r"Local is defined in a function"):
        muscle_as_dict(famjax.Muscle(known.CYLINDER, Local([1.0])))
    with pytest.raises(InputError, match=r"a card cannot store the field 'modulus' of Undeclared"):
        muscle_as_dict(famjax.Muscle(known.CYLINDER, Undeclared([1.0])))
    with pytest.raises(InputError, match=r"muscle\.deadband_pressure must be finite"):
        muscle_as_dict(famjax.Muscle(known.CYLINDER, known.LATEX, float("nan")))


def test_a_notebook_shows_verdict_numbers_and_isobars():
    shown = famjax.muscles.open_card("dmsp-10")._repr_html_()
    assert "identified with doubts" in shown
    assert "EndEffectGeometry" in shown
    assert "</svg>" in shown
