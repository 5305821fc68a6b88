from .choose import Choice as Choice, choose as choose
from .ladder import Candidate as Candidate, ladder as ladder
from .nested import NestedValidation as NestedValidation, validate_choice as validate_choice
from .other_lengths import OtherLengths as OtherLengths
from .ranking import Tried as Tried
from .report import choice_as_dict as choice_as_dict, choice_table as choice_table
from .series import (
    DEFAULT_LAWS as DEFAULT_LAWS,
    Series as Series,
    identify_series as identify_series,
)
