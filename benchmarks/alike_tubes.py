"""Muscles of `thick_tube.py` that a real force map cannot tell apart.

Law, filler, ends and rig are drawn and held; modulus, angle, deadband, threads and the rest are fitted.
Few lengths leave open how the force goes between them: what these muscles disagree by is what such a map
does not say.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares
from thick_tube import Rubber, Tube, drawn_rubber

FITS_WITHIN = 1.5
"""RMSE [N] on the loaded readings."""

_NO_MUSCLE, _HOPELESS = 1e4, 8.0  # N: where there is no equilibrium; RMSE after the first steps


@dataclasses.dataclass(frozen=True)
class _Unknown:
    """A number that is fitted: where it begins at random, and its bounds."""

    low: float
    high: float
    put: Callable[[Tube, float], Tube]


def fitted_tube(
    length: np.ndarray, pressure: np.ndarray, force: np.ndarray, seed: int
) -> tuple[Tube, float]:
    """A muscle that fits loaded readings within `FITS_WITHIN`, and its RMSE [N].

    Law, ends, rig and where each number begins are drawn; where the fit is worse, they are drawn anew.

    Args:
        length: of the readings [m], the longest of them that at rest.
        pressure: of the readings [Pa].
        force: of the readings [N], > 0.
        seed: seed of the random draws.
    """
    random = np.random.default_rng((seed, 2))
    while True:
        tube, unknowns = _drawn(random, float(length.max()))

        def of(numbers: np.ndarray, tube: Tube = tube, unknowns=tuple(unknowns)) -> Tube:
            for unknown, number in zip(unknowns, numbers, strict=True):
                tube = unknown.put(tube, float(number))
            return tube

        def residuals(numbers: np.ndarray, of=of) -> np.ndarray:
            return np.nan_to_num(of(numbers).reading(length, pressure), nan=_NO_MUSCLE) - force

        low, high = (np.array([getattr(one, end) for one in unknowns]) for end in ("low", "high"))
        at = low + random.uniform(0.1, 0.6, low.size) * (high - low)
        for tries, worst in ((8, _HOPELESS), (25, FITS_WITHIN)):
            found = least_squares(
                residuals, at, bounds=(low, high), x_scale=high - low, max_nfev=tries,
                diff_step=1e-5,
            )  # fmt: skip
            at, rmse = found.x, float(np.sqrt(np.mean(found.fun**2)))
            if rmse > worst:
                break
        else:
            return of(at), rmse


def _drawn(random: np.random.Generator, rest: float) -> tuple[Tube, list[_Unknown]]:
    """A muscle of 10 mm bore in its rig, and what of it is fitted."""
    law = dataclasses.replace(
        drawn_rubber(random, 1e6), plateau=float(random.uniform(0, 1e6)),
        knee=float(np.exp(random.uniform(np.log(0.03), np.log(0.4)))),
    )  # fmt: skip
    ends = ("none", "cones", "domes")[int(random.integers(3))]
    tube = Tube(
        rest, 0.010, 1.8e-3, float(random.uniform(0.1, 0.9)), np.deg2rad(64.0), law, ends=ends,
        end_size=float(random.uniform(1.2, 4.0) if ends == "cones" else random.uniform(0.5, 3.0)),
    )  # fmt: skip

    def put(name: str) -> Callable[[Tube, float], Tube]:
        return lambda tube, value: dataclasses.replace(tube, **{name: value})

    def rubber(change: Callable[[Rubber, float], Rubber]) -> Callable[[Tube, float], Tube]:
        return lambda tube, value: dataclasses.replace(tube, rubber=change(tube.rubber, value))

    def shape(place: int) -> Callable[[Tube, float], Tube]:
        return rubber(
            lambda law, value: dataclasses.replace(
                law, shape=(*law.shape[:place], value, *law.shape[place + 1 :])
            )
        )

    ranges = {
        "mooney-rivlin": ((0.0, 1.0),),
        "ogden": ((1.0, 6.0), (-10.0, -0.5), (0.0, 1.0)),
        "gent": ((1.0, 30.0),),
        "yeoh": ((-0.3, 0.5), (0.0, 0.3)),
    }[law.law]
    unknowns = [
        _Unknown(0.1, 4.0, rubber(lambda law, v: dataclasses.replace(law, modulus=1e6 * v))),
        _Unknown(60.0, 70.0, lambda tube, v: dataclasses.replace(tube, angle=np.deg2rad(v))),
        _Unknown(0.0, 6e4, put("deadband")),
        _Unknown(0.0, 2e-5, put("thread_stretch")),
        *(_Unknown(low, high, shape(k)) for k, (low, high) in enumerate(ranges)),
    ]
    if random.random() < 0.6:
        unknowns += [_Unknown(0.0, 5e-6, put("rig_give")), _Unknown(0.0, 2e-3, put("rig_play"))]
        tube = dataclasses.replace(tube, taut=float(random.uniform(20, 100)))
    if ends != "none":
        unknowns.append(_Unknown(*((1.0, 5.0) if ends == "cones" else (0.0, 4.0)), put("end_size")))
    return tube, unknowns
