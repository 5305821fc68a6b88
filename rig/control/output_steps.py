"""The pump or valve stepped with the controller off, for its feed-forward."""

from collections.abc import Callable, Sequence

from ..calibration.feed_forward import FeedForward, fit_feed_forward
from ..link.mean_counts import mean_counts
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
        counts, _ = mean_counts(rig.link, average, rig.wait)
        pressures.append(float(rig.calibration.pressure.value(counts)))
        rig.note("step", output=int(output), pressure_Pa=pressures[-1])
        if tell is not None:
            tell(int(output), pressures[-1])
    rig.stop()
    return fit_feed_forward(pressures, outputs)
