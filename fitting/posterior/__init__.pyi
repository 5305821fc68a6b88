from .diagnostics import (
    effective_size as effective_size,
    effective_size_of_tails as effective_size_of_tails,
    r_hat as r_hat,
)
from .nuts import load_blackjax as load_blackjax
from .plot import plot_posterior as plot_posterior
from .report import (
    posterior_as_dict as posterior_as_dict,
    posterior_table as posterior_table,
    posterior_warnings as posterior_warnings,
)
from .result import Posterior as Posterior, Summary as Summary
from .sampling import sample as sample
from .specimens import sample_each as sample_each
