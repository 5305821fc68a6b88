"""Errors keep their path and figures on every way they take."""

import pickle

import pytest

from imaging import ImagingError, errors
from imaging.errors import Defocused

KINDS = [
    kind
    for kind in vars(errors).values()
    if isinstance(kind, type) and issubclass(kind, ImagingError)
]


def test_all_kinds_are_there():
    assert len(KINDS) >= 18  # the list and their parent


@pytest.mark.parametrize("kind", KINDS)
def test_error_survives_the_way_between_processes(kind):
    error = kind("too little", path="a/b.jpg", blur_px=6.25, tapes=1)
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is kind
    assert (again.message, again.path, again.figures) == (
        "too little", "a/b.jpg", {"blur_px": 6.25, "tapes": 1},
    )  # fmt: skip
    assert str(again) == "a/b.jpg: too little [blur_px = 6.25, tapes = 1]"


def test_path_is_added_once():
    error = Defocused("blurred", blur_px=7.0)
    assert str(error) == "blurred [blur_px = 7]"
    assert error.at("x.jpg").path == "x.jpg"
    assert error.at("x.jpg").at("y.jpg").path == "x.jpg"
    assert isinstance(error, ValueError)
