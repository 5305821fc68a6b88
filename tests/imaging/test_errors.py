"""Errors keep their path and figures on every way they take."""

import pickle

import pytest

from imaging import ImagingError, errors

KINDS = [
    kind
    for kind in vars(errors).values()
    if isinstance(kind, type) and issubclass(kind, ImagingError)
]


@pytest.mark.parametrize("kind", KINDS)
def test_error_survives_the_way_between_processes(kind):
    error = kind("too little", path="a/b.jpg", blur_px=6.25, tapes=1)
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is kind
    assert (again.message, again.path, again.figures) == (
        "too little", "a/b.jpg", {"blur_px": 6.25, "tapes": 1},
    )  # fmt: skip
    assert str(again) == "a/b.jpg: too little [blur_px = 6.25, tapes = 1]"
