"""A rig that vents however a test ends: pressure control for a plan, and its record."""

from collections.abc import Callable
from typing import NoReturn, Self

from famjax.boundary.units import UNITS

from ..calibration.sensor import READINGS
from ..calibration.whole_rig import Calibration
from ..errors import RigError
from ..fault import ADVICE, RigFault
from ..journal.writer import Journal
from ..link.abstract_link import AbstractLink
from ..link.events import Lost, Reset, Silent
from ..protocol.control_law import TICK_HZ
from ..protocol.messages import DRIVEN, FAULTS, RUN, STATES, TRIP, Sample
from .limits_and_gains import JUMP_LIMIT, Control, Guards, RigSettings
from .send_settings import greet, set_up
from .tripped import at_trip

LOOK = 0.05
"""Time [s] between two looks at the device's state during a wait."""
SETTLE = 0.7
"""Time [s] for which the device keeps its last records."""
_PSI = UNITS["pressure"]["psi"]


class Rig:
    """A device under a pressure limit, recorded; leaving the `with` block vents it, however it ends.

    Args:
        link: to the device.
        calibration: of its sensors and its valve or pump.
        pressure_limit: at which the device trips [Pa gauge]; there is no default.
        control: gains.
        jump_limit: change of the pressure within 10 ms at which the device trips [Pa].
        guards: when the device rejects its reading as implausible.
        journal: records everything, or None.
        camera: called with a name to take a photograph, or None.

    Attributes:
        settings: what the device controls and trips with.
        lost: records that the line lost.
        unseen: faults of its transducer that the device cannot detect, in sentences; known once entered.
        set_point: the pressure that was set last [Pa], nan before.

    Raises:
        RigError: no pressure limit, or a limit that the transducer cannot see.
    """

    def __init__(
        self,
        link: AbstractLink,
        calibration: Calibration,
        *,
        pressure_limit: float,
        control: Control,
        jump_limit: float = JUMP_LIMIT,
        guards: Guards | None = None,
        journal: Journal | None = None,
        camera: Callable[[str], None] | None = None,
    ) -> None:
        self.link = link
        self.calibration = calibration
        self.settings = RigSettings(pressure_limit, control, jump_limit, guards or Guards())
        self.settings.commands(calibration)  # refused before the port is used
        self.lost = 0
        self.unseen: tuple[str, ...] = ()
        self._journal = journal
        self._camera = camera
        self.set_point = float("nan")
        self._active_from: int | None = None
        self._cancelled = False

    def __enter__(self) -> Self:
        self.link.attach(self._journal)
        try:
            greet(self.link)
            found = set_up(self.link, self.calibration, self.settings)
            self.unseen = found["unseen"]
            self.note("rig", **found)
        except BaseException as error:
            self._leave(error)
            raise
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        self._leave(error)

    def note(self, kind: str, /, **fields: object) -> None:
        """A note in the journal, if there is one."""
        if self._journal is not None:
            self._journal.note(kind, **fields)

    def set_pressure(self, pressure: float) -> None:
        """Hold a pressure from now on.

        Args:
            pressure: [Pa gauge], >= 0 and below the limit.

        Raises:
            RigError: it is not, or the feed-forward does not know it.
        """
        limit = self.settings.pressure_limit
        if not 0 <= pressure < limit:
            raise RigError(
                f"a set pressure must be >= 0 and below the limit of {limit:.0f} Pa, got "
                f"{pressure:.0f} Pa"
            )
        feed_forward = self.calibration.feed_forward.output(pressure)
        answer = self.link.command("set", pressure / _PSI, feed_forward)
        self.note("set", pressure_Pa=pressure, feed_forward_counts=feed_forward, seq=answer.seq)
        self.set_point = pressure
        self._active("run")

    @property
    def pressure(self) -> float:
        """The newest record's pressure [Pa gauge], nan where there is none."""
        return float(self.calibration.pressure.value(self._newest("pressure_sum")))

    @property
    def force(self) -> float:
        """The newest record's force [N], nan where there is none."""
        return float(self.calibration.force.value(self._newest("force_sum")))

    def _newest(self, name: str) -> float:
        """Sum of five readings in the newest record [counts], nan where there is none."""
        newest, settings = self.link.newest, self.link.session.settings
        if newest is None or settings is None:
            return float("nan")
        return getattr(newest, name) * READINGS / settings.ticks_per_record

    def manual(self, output: int) -> None:
        """Hold an output [counts, 0..255] with the controller off, for calibrations."""
        self._active("man", output)
        self.note("manual", output=output)

    def stop(self) -> None:
        """Output off, dump valve open."""
        self._active_from = None
        self.link.command("stop")

    def wait(self, seconds: float) -> None:
        """Wait for a time [s] and supervise the rig meanwhile.

        Raises:
            RigFault: the device tripped, was reset or is silent, or the recorder has failed.
        """
        end = self.link.now + seconds
        self.link.kick()
        while (left := end - self.link.now) > 1e-9:
            self.link.sleep(min(LOOK, left))
            self.link.kick()
            self.check()

    def check(self) -> None:
        """Look at the device, the link and the recorder once; see `wait`."""
        self.link.check()
        while self.link.alarms:
            match self.link.alarms.popleft():
                case Lost(_, _, records):
                    self.lost += records
                case Reset(old, new, cause):
                    self._fault(
                        f"the device was reset (boot {old} to {new}, cause {cause}); it vents; "
                        "check its supply"
                    )
                case Silent(seconds):
                    self._fault(
                        f"the device is silent for {seconds:.1f} s; it vents by itself; check the "
                        "cable"
                    )
        newest, since = self.link.newest, self._active_from
        if newest and since is not None and newest.seq >= since and newest.state not in DRIVEN:
            self._left_by_itself(newest)
        if self._cancelled:
            self._fault("the test was stopped on request")

    def cancel(self) -> None:
        """End the test at the next look, from any thread."""
        self._cancelled = True

    def sync(self, seconds: float) -> None:
        """Raise the sync pin for a time [s], in whole records, and note with which one it begins.

        Raises:
            RigError: less than a record or more than a thousand.
        """
        settings = self.link.session.settings
        ticks = settings.ticks_per_record if settings else READINGS
        records = round(seconds * TICK_HZ / ticks)
        answer = self.link.command("sync", records)
        self.note("sync", seq=answer.seq, records=records)

    def trigger(self, name: str) -> None:
        """Take a photograph and note the tick of the request."""
        newest = self.link.newest
        self.note("trigger", name=name, tick=newest.tick if newest else None)
        if self._camera is not None:
            self._camera(name)

    def _left_by_itself(self, record: Sample) -> NoReturn:
        """Report why, for a trip with the reading and the output at that moment."""
        self._active_from = None
        self.link.sleep(LOOK)  # the status follows the record
        fault, status = FAULTS[record.fault], self.link.session.status
        at, trip = "", {}
        if record.state == TRIP and status is not None and status.state == TRIP:
            at = at_trip(status, self.calibration)
            trip = {
                "cause": fault,
                "tick": status.tripped_at,
                "counts": status.tripped_count,
                "output": status.tripped_output,
            }
        self._fault(
            f"the device went to {STATES[record.state]} by itself: {fault}{at}; it has vented. "
            + ADVICE.get(fault, "").capitalize(),
            **trip,
        )

    def _fault(self, what: str, **trip: object) -> NoReturn:
        """Stop the heartbeats and raise; a fault is reported once."""
        self._active_from = None
        self.link.rest()
        self.note("fault", what=what, **trip)
        raise RigFault(what)

    def _active(self, verb: str, *values: float) -> None:
        newest = self.link.newest
        if verb == "run" and self._active_from is not None and newest and newest.state == RUN:
            return
        self.link.kick()
        self._active_from = None
        self._active_from = self.link.command(verb, *values).seq

    def _leave(self, error: BaseException | None) -> None:
        """Vent, note how the test ended, and detach the journal."""
        self.link.rest()
        failure: RigFault | None = RigFault("interrupted before the device had stopped")
        try:
            self.stop()
            failure = None
        except (RigError, RigFault) as stop_error:
            failure = RigFault(
                f"the device did not confirm that it stopped ({stop_error}); without heartbeats it "
                "vents by itself within a second: look at the pressure before you touch the rig"
            )
        finally:
            self.link.settle(SETTLE if failure is None else 0.0)
            reason = "complete" if error is None else f"{type(error).__name__}: {error}"
            self.note("end", reason=reason, confirmed=failure is None)
            self.link.attach(None)
        if failure is not None and error is None:
            raise failure
        if failure is not None and error is not None:
            error.add_note(str(failure))
