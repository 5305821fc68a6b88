"""Exceptions raised if a photograph cannot be measured, one class per cause."""

# ruff: noqa: N818 - the class names state the cause

import functools
from os import PathLike, fspath
from typing import Any, Self

from famjax.boundary.errors import InputError


class ImagingError(InputError):
    """A picture, ruler or log cannot be used.

    Instances, including all their attributes, can be pickled.

    Args:
        message: what is required, what was found, and what to do.
        path: file that caused the error, if any.
        figures: values that caused the error, in SI units or with the unit in the name.

    Examples:
        >>> print(NoMuscle("nothing bright stands out from the cloth", path="a.jpg", eta_value=0.2))
        a.jpg: nothing bright stands out from the cloth [eta_value = 0.2]
    """

    def __init__(
        self, message: str, *, path: str | PathLike[str] | None = None, **figures: float | str
    ) -> None:
        super().__init__(message)
        self.message = message
        self.path = None if path is None else fspath(path)
        self.figures = figures

    def __str__(self) -> str:
        place = "" if self.path is None else f"{self.path}: "
        figures = ", ".join(f"{name} = {_figure(value)}" for name, value in self.figures.items())
        return place + self.message + (f" [{figures}]" if figures else "")

    def __reduce__(self) -> tuple[Any, ...]:
        rebuild = functools.partial(type(self), self.message, path=self.path, **self.figures)
        return rebuild, ()

    def at(self, path: str | PathLike[str]) -> Self:
        """Return a copy with this file path, unless a path is already set."""
        return type(self)(self.message, path=self.path or path or None, **self.figures)


def _figure(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


class UnreadableImage(ImagingError):
    """The file is missing, empty, truncated or not a picture."""


class DamagedImage(ImagingError):
    """The file can be decoded, but part of the picture is damaged."""


class NoMuscle(ImagingError):
    """No muscle can be distinguished from the background cloth."""


class Underexposed(ImagingError):
    """The muscle is too dark to measure."""


class Overexposed(ImagingError):
    """Too many of the muscle's pixels are saturated, which hides the edges."""


class AmbiguousHue(ImagingError):
    """The tape's colour cannot be distinguished from the braid's."""


class MissingFitting(ImagingError):
    """Fewer than two tapes are visible, or one of them is covered."""


class ExtraFitting(ImagingError):
    """More than two tapes are visible, so the ends of the braid are ambiguous."""


class Clipped(ImagingError):
    """The muscle or a tape extends beyond the picture."""


class WrongOrientation(ImagingError):
    """The muscle is horizontal where it should be vertical, or vice versa."""


class Defocused(ImagingError):
    """The picture is too blurred for reliable standard errors."""


class MotionBlurred(ImagingError):
    """The muscle moved while the shutter was open."""


class RulerNotFound(ImagingError):
    """No ruler was found, or too few of its marks are visible."""


class AmbiguousRuler(ImagingError):
    """The marks on the ruler can be read in more than one way."""


class MixedSizes(ImagingError):
    """The pictures in a campaign differ in size, so no single recipe applies to all of them."""


class DistanceContradiction(ImagingError):
    """The curvature of the tape edges contradicts the stated camera distance."""


class ScaleContradiction(ImagingError):
    """The scale contradicts a known dimension in the picture."""
