"""The pump or valve stepped with the controller off, for its feed-forward."""

from collections.abc import Callable, Sequence
from pathlib import Path

from ..calibration.feed_forward import FeedForward, fit_feed_forward
from ..calibration.whole_rig import read_calibration, update_calibration
from ..errors import RigError
from ..link.abstract_link import AbstractLink
from .plan_file import PlanFile
from .rig import Rig


def calibrate_feed_forward(
    rig: Rig,
    outputs: Sequence[int],
    *,
    settle: float = 3.0,
    average: float = 1.0,
    tell: Callable[[int, float], None] | None = None,
) -> FeedForward:
    """The feed-forward from steps of the pump or valve, the controller off.

    Args:
        rig: entered.
        outputs: steps [counts, 0..255]; going up and down again shows hysteresis as scatter.
        settle: time after each step [s].
        average: time of each mean [s].
        tell: called after each step with its output [counts] and pressure [Pa].

    Returns:
        The cubic through the steps, with its error.

    Raises:
        RigError: the pressure does not rise with the output.
        RigFault: the test had to stop, as where a step reaches the pressure limit.
    """
    pressures = []
    for output in outputs:
        rig.manual(int(output))
        rig.wait(settle)
        counts, _ = rig.average(average)
        pressures.append(float(rig.calibration.pressure.value(counts)))
        rig.note("step", output=int(output), pressure_Pa=pressures[-1])
        if tell is not None:
            tell(int(output), pressures[-1])
    rig.stop()
    return fit_feed_forward(pressures, outputs)


def calibrate_pump(
    test: PlanFile,
    link: AbstractLink,
    outputs: Sequence[int],
    *,
    settle: float = 3.0,
    tell: Callable[[int, float], None] | None = None,
) -> tuple[FeedForward, Path]:
    """Step a test's pump under the test's limits, and enter the result in its calibration.

    Args:
        test: circuit, limits, gains and calibration; its plan is not run.
        link: to the device.
        outputs: as for `calibrate_feed_forward`.
        settle: as for `calibrate_feed_forward`.
        tell: as for `calibrate_feed_forward`.

    Returns:
        The feed-forward, and the file that holds it now.

    Raises:
        RigError: the circuit has no pump, the test names no calibration, an output is not 0..255, or
            as `calibrate_feed_forward`; the file is left as it was.
        RigFault: as `calibrate_feed_forward`.
    """
    if test.circuit != "water":
        raise RigError(
            f"the pump of a water circuit is stepped; the circuit is {test.circuit!r}, whose valve "
            "neither fills nor empties at its middle, 127.5 counts, whatever the pressure"
        )
    if test.calibration is None:
        raise RigError("[rig] must name a calibration, as in calibration = 'calibration.toml'")
    beyond = [output for output in outputs if not 0 <= output <= 255]
    if beyond:
        raise RigError(f"an output is 0 to 255 counts, got {beyond[0]}")
    calibration = read_calibration(test.calibration)
    with Rig(
        link, calibration, pressure_limit=test.pressure_limit, control=test.control,
        jump_limit=test.jump_limit, guards=test.guards,
    ) as rig:  # fmt: skip
        found = calibrate_feed_forward(rig, outputs, settle=settle, tell=tell)
    update_calibration(test.calibration, "feed_forward", found)
    return found, test.calibration
