from .gathered import (
    Evidence as Evidence,
    gather as gather,
    left_out_kinds as left_out_kinds,
)
from .left_out import LeftOut as LeftOut
from .likelihood import Profile as Profile, profile as profile
from .model_error import ModelError as ModelError
from .resampling import Bootstrap as Bootstrap, bootstrap as bootstrap
from .shared_errors import (
    Carried as Carried,
    Move as Move,
    carry as carry,
    drawn_moves as drawn_moves,
    moves_of as moves_of,
)
from .validation import Validation as Validation, validate as validate
