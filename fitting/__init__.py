"""Identification of fluidic artificial muscles: data with units in, a certified model out.

Start with `read_csv` or `load_bundled` and `identify`; `validate`, `profile` and `bootstrap` say how
far the result can be trusted, `compare` sets it beside the published models. `fitting.records`,
`fitting.ramps` and `fitting.rubber` turn raw tests into force maps and moduli.
"""

from famjax.boundary.public_names import attach_rooms

__famjax__ = "0.1.0"

_MOVED = {"famjax.cards": ("muscle_as_dict", "muscle_from_dict")}

__getattr__, __dir__, __all__ = attach_rooms(__name__, __file__, _MOVED)
