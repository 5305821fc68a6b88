"""What stops a test: the device, the link or the recorder is not as it must be."""

ADVICE = {
    "silence": "it heard nothing for a second; look at the cable and at what keeps this computer busy",
    "over-pressure": "the pressure limit was reached, or the transducer is unplugged",
    "jump": (
        "the pressure changed by more than the jump limit in 10 ms: a transducer that fails, or a "
        "small muscle that fills fast; then raise jump_limit_<unit> in the plan's [rig], or step less"
    ),
    "stall": "full output raised nothing for 3 s; look at supply, hose and muscle",
    "watchdog": "its program had stopped; look at its supply",
}
"""What to look at after each fault of the device."""


class RigFault(RuntimeError):  # noqa: N818 -- what the device calls one
    """What was seen, and what to look at; the rig is vented, or vents by itself within a second."""
