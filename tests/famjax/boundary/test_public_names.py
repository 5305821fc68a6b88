"""Public names: by room, a dozen at the top, and old ones with a word about where they are."""

import importlib

import pytest

PACKAGES = ("famjax", "rig")


@pytest.mark.parametrize("name", PACKAGES)
def test_every_listed_name_is_there(name: str) -> None:
    package = importlib.import_module(name)
    for room in package.__all__:
        for public in getattr(getattr(package, room), "__all__", ()):
            assert hasattr(getattr(package, room), public), (room, public)
    assert set(dir(package)) == set(package.__all__)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("famjax.NeoHookeanMaterial", "famjax.materials"),
    ],
)
def test_an_old_name_still_works_and_says_where_it_is(old: str, new: str) -> None:
    package, _, name = old.partition(".")
    with pytest.warns(DeprecationWarning, match=rf"{old} is now {new}.{name}"):
        found = getattr(importlib.import_module(package), name)
    assert found is getattr(importlib.import_module(new), name)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="Nonsense"):
        importlib.import_module("famjax").Nonsense  # noqa: B018
