"""The muscle in a simulated rig: force and volume, tabulated so that a step costs a microsecond."""

import math
from collections.abc import Sequence

import numpy as np

from ..errors import RigError
from .circuits import PSI

INCH = 0.0254
POUND = 4.4482216152605

_Cell = tuple[int, int, float, float, float, float, float, float, float, float]
"""i, j; of F and then of V, at the lower and the upper length: value, step to the next pressure."""


class SimulatedMuscle:
    """Force and volume of a muscle on a grid of lengths and pressures, linear in between.

    Beyond the pressures of the grid both go on in a straight line; beyond its lengths is an error.

    Args:
        lengths: active lengths L [m], rising evenly, shape (n,).
        pressures: gauge pressures P [Pa], rising evenly, shape (m,).
        force: F [N], shape (n, m), positive when the muscle pulls.
        volume: of fluid V [m3], shape (n, m).
        rest_length: L0 [m], within the lengths.
        friction: part of F by which it falls short of the mean while the muscle shortens and
            exceeds it while the muscle lengthens; ASSUMED where it is not measured.
        friction_travel: [m] of motion over which the friction turns round after a reversal; ASSUMED.

    Raises:
        RigError: the grid is not even, or the shapes do not agree.
    """

    def __init__(
        self,
        lengths: Sequence[float] | np.ndarray,
        pressures: Sequence[float] | np.ndarray,
        force: np.ndarray,
        volume: np.ndarray,
        *,
        rest_length: float,
        friction: float = 0.02,
        friction_travel: float = 2e-4,
    ) -> None:
        lengths, pressures = np.asarray(lengths, float), np.asarray(pressures, float)
        shape = (lengths.size, pressures.size)
        for name, table in (("force", force), ("volume", volume)):
            if np.shape(table) != shape or not np.all(np.isfinite(table)):
                raise RigError(f"{name} must be finite with shape {shape}, got {np.shape(table)}")
        for name, grid in (("lengths", lengths), ("pressures", pressures)):
            steps = np.diff(grid)
            if grid.size < 2 or steps[0] <= 0 or not np.allclose(steps, steps[0], rtol=1e-6):
                raise RigError(f"{name} must rise in even steps, at least two values, got {grid}")
        if np.any(np.asarray(volume) <= 0):
            raise RigError(f"volume must be positive, the least is {np.min(volume):.3g} m3")
        if not (0 <= friction < 1 and friction_travel > 0):
            raise RigError(
                f"friction must lie in [0, 1) and its travel be positive, got {friction} and "
                f"{friction_travel} m"
            )
        if not lengths[0] < rest_length <= lengths[-1]:
            raise RigError(
                f"rest_length must lie within the lengths, {lengths[0]:.5g} to {lengths[-1]:.5g} m, "
                f"got {rest_length} m"
            )
        self.lengths, self.pressures, self.rest_length = lengths, pressures, float(rest_length)
        self.friction, self.friction_travel = friction, friction_travel
        self._L0, self._per_L = float(lengths[0]), 1 / float(lengths[1] - lengths[0])
        self._P0, self._per_P = float(pressures[0]), 1 / float(pressures[1] - pressures[0])
        self._last = (lengths.size - 2, pressures.size - 2)
        pairs = np.stack([np.asarray(force, float), np.asarray(volume, float)], axis=-1)
        self._rows: list[list[list[float]]] = pairs.tolist()
        self._cell = self._corners(0, 0)  # the last one used

    def at(self, length: float, pressure: float) -> tuple[float, float, float, float]:
        """Force and volume at an active length L [m] and gauge pressure P [Pa].

        Returns:
            F [N], the mean of shortening and lengthening; V [m3]; dV/dL [m2]; dV/dP [m3/Pa].

        Raises:
            RigError: the length lies outside the table.
        """
        x, y = (length - self._L0) * self._per_L, (pressure - self._P0) * self._per_P
        cell = self._cell
        if not (cell[0] <= x < cell[0] + 1 and cell[1] <= y < cell[1] + 1):
            self._cell = cell = self._corners(*self._cell_of(length, x, y))
        i, j, F, across, F_up, across_up, V, give, V_up, give_up = cell
        x, y = x - i, y - j
        low, high = F + across * y, F_up + across_up * y
        below, over = V + give * y, V_up + give_up * y
        return (
            low + (high - low) * x,
            below + (over - below) * x,
            (over - below) * self._per_L,
            (give + (give_up - give) * x) * self._per_P,
        )

    def _cell_of(self, length: float, x: float, y: float) -> tuple[int, int]:
        """The cell of a point of the grid: beyond its pressures the outermost, beyond its lengths none."""
        i, j = int(x), int(y)
        last_i, last_j = self._last
        if i > last_i or x < 0.0:
            if not -1e-9 <= x <= last_i + 1 + 1e-9:
                raise RigError(
                    f"length {length:.6g} m lies outside the muscle's table, {self.lengths[0]:.6g} "
                    f"to {self.lengths[-1]:.6g} m: shorten the stroke or widen the table"
                )
            i = last_i if i > last_i else 0
        return i, 0 if j < 0 else j if j < last_j else last_j

    def _corners(self, i: int, j: int) -> _Cell:
        (F, V), (F_right, V_right) = self._rows[i][j : j + 2]
        (F_up, V_up), (F_far, V_far) = self._rows[i + 1][j : j + 2]
        return i, j, F, F_right - F, F_up, F_far - F_up, V, V_right - V, V_up, V_far - V_up

    def force(self, length: float, pressure: float) -> float:
        """F [N] of `at`."""
        return self.at(length, pressure)[0]


def mckibben(
    *,
    rest_length: float = 9.28125 * INCH,
    thread_length: float = 9.89 * INCH,
    turns: float = 1.09,
    solid_volume: float = 1.754 * INCH**3,
    stiffness: float = 22.6 * POUND / INCH,
    deadband_pressure: float = 3.3 * PSI,
    friction: float = 0.02,
) -> SimulatedMuscle:
    """A muscle of an inelastic braid and a linear bladder, for a rig without a muscle model.

    V = (B^2 L - L^3) / (4 pi N^2) - V_solid,  F = (P - P_d) (3 L^2 - B^2) / (4 pi N^2) - k (L0 - L)

    The defaults are the reference work's 7/8 in muscle; stiffness and deadband were chosen to come
    within 5 % of its printed blocked force, and within 0.03 of its free contraction from 40 psi.

    Args:
        rest_length: L0 [m].
        thread_length: B [m].
        turns: N of one thread.
        solid_volume: of bladder and braid [m3], in which there is no fluid.
        stiffness: k [N/m] of the bladder; ASSUMED.
        deadband_pressure: P_d [Pa]; ASSUMED.
        friction: see `SimulatedMuscle`; ASSUMED.

    Returns:
        The muscle, tabulated from just beyond the neutral angle to 2 % above L0.

    Raises:
        RigError: L0 is not between the neutral angle and the thread's own length.

    References:
        Chambers 2021, tables 6.11 and 6.12.
    """
    neutral = thread_length / math.sqrt(3)
    if not neutral < rest_length < thread_length:
        raise RigError(
            f"rest_length must lie between thread_length / sqrt(3) = {neutral:.5g} m and "
            f"thread_length = {thread_length:.5g} m, got {rest_length} m"
        )
    four = 4 * math.pi * turns**2
    longest = min(1.02 * rest_length, (rest_length + thread_length) / 2)
    lengths = np.linspace(0.95 * neutral, longest, 401)[:, None]
    pressures = np.linspace(0, 120 * PSI, 25)[None, :]
    area = (3 * lengths**2 - thread_length**2) / four
    pull = (pressures - deadband_pressure) * area - stiffness * (rest_length - lengths)
    volume = (thread_length**2 * lengths - lengths**3) / four - solid_volume
    volume = np.broadcast_to(volume, pull.shape)
    return SimulatedMuscle(
        lengths[:, 0], pressures[0], pull, volume, rest_length=rest_length, friction=friction
    )
