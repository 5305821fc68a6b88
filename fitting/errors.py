"""The error raised for invalid input."""

from famjax.boundary.errors import InputError as InputError
