"""The one error that tells a person what is wrong with what they gave."""


class InputError(ValueError):
    """What must hold, what was got, and what to do; the command line prints it and exits with 2."""
