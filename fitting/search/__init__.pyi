from .identification import identify as identify, identify_together as identify_together
from .result import (
    Certificate as Certificate,
    Errors as Errors,
    Estimate as Estimate,
    Identification as Identification,
)
