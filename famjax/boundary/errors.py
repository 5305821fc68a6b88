"""The one family of errors that say what is wrong with what was given."""


class InputError(ValueError):
    """What must hold, what was got, and what to do; the command line prints it and exits with 2."""
