"""The one error that a person can mend: input, plan, port or file."""


class RigError(ValueError):
    """What must hold, what came, and what to do; the command line prints it without a traceback."""
