from .card import (
    Covariance as Covariance,
    MuscleCard as MuscleCard,
    Provenance as Provenance,
    Sample as Sample,
    card_as_document as card_as_document,
    card_from_document as card_from_document,
    read_card as read_card,
    schema as schema,
    slip_as_dict as slip_as_dict,
    slip_from_dict as slip_from_dict,
    unidentified as unidentified,
    write_card as write_card,
)
from .draws import draw as draw
from .parts import muscle_as_dict as muscle_as_dict, muscle_from_dict as muscle_from_dict
