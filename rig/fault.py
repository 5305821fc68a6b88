"""What stops a test: a fault of the device, the link or the recorder."""

ADVICE = {
    "silence": "no line reached it for a second; check the cable and the load on this computer",
    "over-pressure": "the pressure limit was reached, or the transducer is unplugged",
    "jump": (
        "the pressure changed by more than the jump limit in 10 ms: a transducer that fails, or a "
        "small muscle that fills fast; then raise jump_limit_<unit> in the plan's [rig], or step less"
    ),
    "stall": (
        "output or integral stood at its limit and the pressure did not rise; check supply, hose, "
        "muscle and transducer"
    ),
    "watchdog": "its program had stopped; check its supply",
    "range": (
        "the reading was outside floor and ceiling: a broken wire, a short, an unplugged transducer "
        "or one without supply"
    ),
    "frozen": (
        "the reading did not vary, or not with the output: check transducer and its line before "
        "anything else, the true pressure may be higher than what was read"
    ),
    "no response": (
        "the pressure did not follow the output after a start or a higher set pressure: a blocked "
        "or kinked line to the transducer, no supply, an open circuit; or a circuit slower than "
        "this guard takes it for: then raise frozen_s in the plan's [rig]"
    ),
}
"""What to check after each fault of the device."""


class RigFault(RuntimeError):  # noqa: N818 -- what the device calls one
    """What was seen, and what to check; the rig is vented, or vents by itself within a second."""
