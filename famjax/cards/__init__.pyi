from .muscle_card import muscle_as_dict as muscle_as_dict, muscle_from_dict as muscle_from_dict
