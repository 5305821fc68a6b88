"""The error of a plan, a port or a file that cannot be used."""

from famjax.boundary.errors import InputError


class RigError(InputError):
    """What must hold, what came, and what to do; the command line prints it without a traceback."""
