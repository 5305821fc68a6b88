"""What stops a test: the device, the link or the recorder is not as it must be."""


class RigFault(RuntimeError):  # noqa: N818 -- what the device calls one
    """What was seen, and what to look at; the rig is vented, or vents by itself within a second."""
