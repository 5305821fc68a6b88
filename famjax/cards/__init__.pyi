from .card import (
    MuscleCard as MuscleCard,
    card_as_document as card_as_document,
    card_from_document as card_from_document,
    read_card as read_card,
    write_card as write_card,
)
from .document import (
    Covariance as Covariance,
    Provenance as Provenance,
    schema as schema,
    unidentified as unidentified,
)
from .draws import Draws as Draws, draw as draw
from .muscle_card import muscle_as_dict as muscle_as_dict, muscle_from_dict as muscle_from_dict
from .slip_card import slip_as_dict as slip_as_dict, slip_from_dict as slip_from_dict
