from .diagnostics import (
    effective_size as effective_size,
    effective_size_of_tails as effective_size_of_tails,
    r_hat as r_hat,
)
from .result import Posterior as Posterior, Summary as Summary
from .sampling import sample as sample
