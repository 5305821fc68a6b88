"""Every way in which a photograph can fail, each with its own error, its figures and its path."""

import functools

import numpy as np
import pytest
from rendering import INCH, CameraSensor, Jpeg, Lens, Tape, damaged, published_scene

from imaging import ImagingError, Scale, errors, measure, read_image
from tests.imaging.photographs import changed, measured_or_refused, photograph, recipe_of

SIZE = (1060, 440)


@functools.cache
def base():
    return published_scene(0.175, size=SIZE)


def muscle(**changes):
    return changed(base(), changes)


def recipe(**options):
    return recipe_of(base(), **options)


def exposed(by):
    return changed(base(), sensor=CameraSensor(exposure=by))


TAN = Tape(hue=40.0, saturation=0.35, value=0.8)
FAILURES = {
    "dark": (lambda: exposed(0.012), errors.Underexposed),
    "bright": (lambda: exposed(5.0), errors.Overexposed),
    "tape like the braid": (lambda: muscle(upper=TAN, lower=TAN), errors.AmbiguousHue),
    "no tapes": (lambda: muscle(upper=None, lower=None), errors.AmbiguousHue),
    "no upper tape": (lambda: muscle(upper=None), errors.MissingFitting),
    "no lower tape": (lambda: muscle(lower=None), errors.MissingFitting),
    "third tape": (lambda: muscle(third=(Tape(), 0.5)), errors.ExtraFitting),
    "out at the right": (lambda: muscle(x0=2.0 * INCH), errors.Clipped),
    "out at the top": (lambda: muscle(y0=-3.0 * INCH), errors.Clipped),
    "tape at the top": (lambda: muscle(y0=-1.6 * INCH), errors.Clipped),
    "lying": (lambda: changed(base(), lying=True), errors.WrongOrientation),
    "defocused": (lambda: changed(base(), lens=Lens(blur_px=5.0)), errors.Defocused),
    "moved": (lambda: changed(base(), lens=Lens(motion_px=12.0)), errors.MotionBlurred),
}


@pytest.mark.parametrize("case", FAILURES)
def test_a_picture_that_cannot_be_measured(case, tmp_path):
    made, error = FAILURES[case]
    path = photograph(made(), 2).save(tmp_path / "picture.jpg")
    with pytest.raises(error) as caught:
        measure(path, recipe())
    assert type(caught.value) is error
    assert caught.value.path == str(path)
    assert caught.value.figures


@pytest.mark.parametrize("level", [0, 30])
def test_no_muscle_at_all(level):
    random = np.random.default_rng(0)
    noise = random.normal(level, 3, (*SIZE, 1)) + random.normal(0, 1, (*SIZE, 3))
    with pytest.raises(errors.NoMuscle):
        measure(np.clip(noise, 0, 255).astype(np.uint8), recipe())


@pytest.mark.parametrize("factor", [0.98, 1.03])
def test_a_scale_that_contradicts_the_tapes(factor):
    tape = Tape(diameter=0.95 * INCH)
    made = muscle(upper=tape, lower=tape)
    rgb = photograph(made, 1).rgb
    wrong = Scale.manual(factor * base().camera.px_per_m)
    with pytest.raises(errors.ScaleContradiction) as caught:
        measure(rgb, recipe(tape_diameter=0.95 * INCH, scale=wrong))
    assert caught.value.figures["diameter"] == pytest.approx(0.95 * INCH / factor, rel=5e-3)


def test_missing_empty_and_foreign_files(tmp_path):
    (tmp_path / "empty.jpg").touch()
    (tmp_path / "text.jpg").write_text("no picture")
    for name in ("absent.jpg", "empty.jpg", "text.jpg"):
        with pytest.raises(errors.UnreadableImage, match=name):
            measure(tmp_path / name, recipe())
    with pytest.raises(errors.UnreadableImage):
        read_image(tmp_path)


@pytest.mark.parametrize("kind", ["scrambled", "blanked"])
@pytest.mark.parametrize("seed", range(3))
def test_a_damaged_file_gives_an_error_or_the_right_figures(tmp_path, kind, seed):
    photo = photograph(changed(base(), jpeg=Jpeg(92)), 1)
    path = tmp_path / "damaged.jpg"
    path.write_bytes(damaged(photo.jpeg(), kind, seed))
    outcome = measured_or_refused(path, recipe())
    if isinstance(outcome, ImagingError):
        assert outcome.path == str(path)
    else:
        assert abs(outcome.length - photo.truth.length) * photo.truth.px_per_m < 1
        off = abs(outcome.mean_diameter - photo.truth.mean_diameter)
        assert off * photo.truth.px_per_m < 1
