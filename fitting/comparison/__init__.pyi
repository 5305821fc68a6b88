from .cross_validation import (
    CrossValidation as CrossValidation,
    GroupError as GroupError,
    cross_validate as cross_validate,
)
from .fit import (
    PeerFit as PeerFit,
    cross_validate_peer as cross_validate_peer,
    fit_peer as fit_peer,
)
from .hocking import fit_hocking_wereley as fit_hocking_wereley
from .league_plot import plot_comparison as plot_comparison
from .league_table import (
    Comparison as Comparison,
    comparable_models as comparable_models,
    compare as compare,
)
from .peer_family import PeerFamily as PeerFamily, PeerParameter as PeerParameter
from .published import peer_families as peer_families
from .row import ComparisonRow as ComparisonRow
