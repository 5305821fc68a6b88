"""Errors of photographs, one class for each case, with its figures."""

# ruff: noqa: N818 - the names say what is wrong; that they are errors, `ImagingError` says

import functools
from os import PathLike, fspath
from typing import Any, Self

from famjax.boundary.errors import InputError


class ImagingError(InputError):
    """A picture, a ruler or a log that cannot be measured: what must hold, what was found, what to do.

    It travels between processes with everything that it carries.

    Args:
        message: what must hold, what was got, what to do.
        path: the file concerned, if there is one.
        figures: the numbers behind the refusal, SI or named with their unit.

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
        """The same error with the path of its file; a known path is kept."""
        return type(self)(self.message, path=self.path or path or None, **self.figures)


def _figure(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


class UnreadableImage(ImagingError):
    """The file is missing, empty, truncated or not a picture."""


class DamagedImage(ImagingError):
    """The file decodes, but part of the picture is damaged."""


class NoMuscle(ImagingError):
    """Nothing in the picture stands out from the cloth like a muscle."""


class Underexposed(ImagingError):
    """The muscle is too dark to be measured."""


class Overexposed(ImagingError):
    """Too much of the muscle is saturated: no edge can be found where the light is clipped."""


class AmbiguousHue(ImagingError):
    """The tape's colour cannot be distinguished from the braid's."""


class MissingFitting(ImagingError):
    """Fewer than two tapes are seen, or one of them is covered."""


class ExtraFitting(ImagingError):
    """More than two tapes are seen, so the ends of the braid are not known."""


class Clipped(ImagingError):
    """The muscle or a tape extends beyond the picture."""


class WrongOrientation(ImagingError):
    """The muscle lies horizontally where it should be upright, or the other way round."""


class Defocused(ImagingError):
    """The picture is too blurred for the accuracy that its errors would state."""


class MotionBlurred(ImagingError):
    """The muscle moved while the shutter was open."""


class RulerNotFound(ImagingError):
    """No ruler, or too few of its marks, can be seen."""


class AmbiguousRuler(ImagingError):
    """The marks can be numbered in more than one way."""


class MixedSizes(ImagingError):
    """The pictures of one campaign differ in size: one recipe cannot hold for all of them."""


class DistanceContradiction(ImagingError):
    """The tapes' edges contradict the stated distance of the camera."""


class ScaleContradiction(ImagingError):
    """The scale and a known diameter in the picture exclude each other."""
