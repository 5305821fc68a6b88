"""What stops a test: a fault of the device, the link or the recorder."""

ADVICE = {
    "silence": "no line reached it for a second; check the cable and the load on this computer",
    "over-pressure": "the pressure limit was reached, or the transducer is unplugged",
    "jump": (
        "the pressure changed by more than the jump limit in 10 ms: a transducer that fails, or a "
        "small muscle that fills fast; then raise jump_limit_<unit> in the plan's [rig], or step less"
    ),
    "stall": "full output raised nothing for 3 s; check supply, hose and muscle",
    "watchdog": "its program had stopped; check its supply",
}
"""What to check after each fault of the device."""


class RigFault(RuntimeError):  # noqa: N818 -- what the device calls one
    """What was seen, and what to check; the rig is vented, or vents by itself within a second."""
