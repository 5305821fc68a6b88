from .choose import Choice as Choice, Tried as Tried, choose as choose
from .ladder import Candidate as Candidate, ladder as ladder
from .nested import NestedValidation as NestedValidation, validate_choice as validate_choice
from .report import choice_as_dict as choice_as_dict, choice_table as choice_table
