"""The muscle back from a `fit.json`, and the figures about it."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np

import famjax
from famjax.boundary.errors import InputError
from famjax.cards import muscle_from_dict, slip_from_dict
from famjax.slip import CentredSlip

from ..arguments import check_path
from ..evidence.model_error import ModelError

SCHEMA = "famjax-fit/1"
_WANTED = "give a fit.json that famjax fit has written"


@dataclasses.dataclass(frozen=True, repr=False)
class SavedFit:
    """A fit read back from `fit.json`.

    Attributes:
        mounted: the identified muscle, bit for bit, in the rig of the fit.
        document: the whole file as plain data, SI.
        hysteresis: about the muscle's force, or None where it was not identified.
        others: further muscles, in their rigs; a prediction is the weighted mean of the muscle and them.
        weights: of the muscle and of them.
        error: of predictions, or None where nothing was left out.
        other_lengths: muscles, in their rigs, of whose forces the mean is that of a muscle of another
            length; none where the fit cannot tell.
        alike: muscles, in their rigs, of other families that fit the readings alike; what they disagree
            about is in the band.
    """

    mounted: famjax.MountedMuscle
    document: dict[str, Any]
    hysteresis: CentredSlip | None = None
    others: tuple[famjax.MountedMuscle, ...] = ()
    weights: tuple[float, ...] = (1.0,)
    error: ModelError | None = None
    other_lengths: tuple[famjax.MountedMuscle, ...] = ()
    alike: tuple[famjax.MountedMuscle, ...] = ()

    @property
    def muscle(self) -> famjax.Muscle:
        """The identified muscle, bit for bit."""
        muscle = self.mounted.muscle
        assert isinstance(muscle, famjax.Muscle)
        return muscle

    def __repr__(self) -> str:
        name = self.document.get("data", {}).get("specimen", {}).get("name", "unnamed")
        return f"SavedFit({name}: law {self.document.get('law')}, RMSE {self.document.get('rmse_N')} N)"


def load_fit(path: str | Path) -> SavedFit:
    """The muscle and the figures of a saved fit.

    Args:
        path: a `fit.json`.

    Returns:
        The fit. Enable float64 in JAX first, or the muscle's numbers are rounded to float32.

    Raises:
        InputError: no such file, not a fit of this program, of a schema it does not know, or one
            that lacks what predictions are made of.
    """
    path = check_path("a saved fit", path)
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path} is not a JSON file: {error}; {_WANTED}") from None
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise InputError(f"{path} must be a fit of schema {SCHEMA!r}, got {schema!r}; {_WANTED}")
    try:
        mounted = _mounted(document)
        _check(document, mounted)
        loops = document.get("hysteresis")
        hysteresis = None if loops is None else slip_from_dict(loops)
        stored = document.get("model_error")
        others = tuple(_mounted(one) for one in document.get("averaged_with") or ())
        weights = [float(_entry(one, "weight")) for one in document.get("averaged_with") or ()]
        alike = tuple(_mounted(one) for one in document.get("alike") or ())
        elsewhere = tuple(
            _mounted(one) for one in (document.get("other_lengths") or {}).get("members", ())
        )
    except InputError as error:
        raise InputError(f"{path} is damaged: {error}") from None
    error = None if stored is None else ModelError.from_dict(stored)
    return SavedFit(
        mounted,
        document,
        hysteresis,
        others,
        (1.0 - sum(weights), *weights),
        error,
        elsewhere,
        alike,
    )


def _mounted(entry: Any) -> famjax.MountedMuscle:
    """A muscle in its rig, from its entry."""
    card = _entry(entry, "muscle")
    if not isinstance(card, dict):
        raise InputError(f"'muscle' must be an object in braces, got {card!r}")
    for name in ("series_compliance_m_per_N", "series_exponent"):
        if entry.get(name) is not None:
            _numbers(entry, name, ())
    return famjax.MountedMuscle(
        muscle_from_dict(card),
        _entry(entry, "series_compliance_m_per_N") or 0.0,
        entry.get("series_exponent"),
    )


def _entry(document: Any, path: str) -> Any:
    """What stands at dotted keys."""
    found = document
    for key in path.split("."):
        if not isinstance(found, dict) or key not in found:
            raise InputError(f"it has no entry {path!r}; write it anew with famjax fit")
        found = found[key]
    return found


def _check(document: dict[str, Any], mounted: famjax.MountedMuscle) -> None:
    """Raise unless what predictions are made of is there, finite and of its shape."""
    _numbers(document, "data.readings.length_m", ("n",))
    _numbers(document, "data.readings.pressure_Pa", ("n",))
    _numbers(document, "data.readings.force_N", ("n",))
    if document.get("spread") is not None:
        varied = jax.tree.leaves(eqx.filter(mounted, eqx.is_inexact_array))
        count = sum(np.size(leaf) for leaf in varied)
        _entry(document, "spread.directions")
        for name in ("directions", "shared_directions"):  # the second came later
            if document["spread"].get(name, []) != []:
                _numbers(document, f"spread.{name}", ("directions", count))
    if document.get("model_error") is not None:
        _numbers(document, "model_error.noise_N", ())
        _numbers(document, "model_error.factor_95", ())
        _numbers(document, "model_error.floor_N", ())
        for name, unit in (("length", "m"), ("pressure", "Pa")):
            _numbers(document, f"model_error.{name}.levels_{unit}", ("n",))
            _numbers(document, f"model_error.{name}.scale_N", ())
            _numbers(document, f"model_error.{name}.freedom", ())
    if document.get("hysteresis") is not None:
        _numbers(document, "hysteresis.rms_N", ())
        for kind in _entry(document, "hysteresis.left_out"):
            _numbers(document, f"hysteresis.left_out.{kind}.rms_N", ())
    if document.get("other_lengths") is not None:
        _numbers(document, "other_lengths.between_N", ())
        _entry(document, "other_lengths.members")
    if document.get("series") is not None:
        _numbers(document, "series.between_N", ())
        _numbers(document, "series.rest_lengths_m", ("n",))
        _numbers(document, "series.length_ratios", (2,))
        _numbers(document, "series.pressures_Pa", (2,))


def _numbers(document: dict[str, Any], path: str, shape: tuple[int | str, ...]) -> None:
    """Raise unless finite numbers of a shape stand there; a word stands for any size but 0."""
    found = _entry(document, path)
    try:
        numbers = np.asarray(found)
    except ValueError:  # lists of unequal lengths
        numbers = np.asarray(None)
    sizes = zip(numbers.shape, shape, strict=False)
    if (
        numbers.dtype.kind not in "fi"
        or numbers.ndim != len(shape)
        or not all(size and (isinstance(want, str) or size == want) for size, want in sizes)
        or not np.isfinite(numbers).all()
    ):
        wanted = ", ".join(map(str, shape))
        raise InputError(
            f"{path!r} must hold finite numbers of shape ({wanted}), got shape {numbers.shape}; "
            "write it anew with famjax fit"
        )
