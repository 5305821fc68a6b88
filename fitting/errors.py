"""The error that says what is wrong with what was given."""

from famjax.boundary.errors import InputError as InputError
