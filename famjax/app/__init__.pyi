from .checks import Check as Check, read_checks as read_checks
from .evaluation import GEOMETRIES as GEOMETRIES, evaluate as evaluate
from .folder import Sheet as Sheet, read_sheet as read_sheet
from .isobaric import (
    Analysis as Analysis,
    analyse as analyse,
    clocks as clocks,
    convert as convert,
    figures as figures,
    plot_characterisation as plot_characterisation,
    table as table,
)
from .photographs import (
    add_log as add_log,
    read_log_of_pictures as read_log_of_pictures,
    with_log as with_log,
)
from .simulation import (
    SimulatedTest as SimulatedTest,
    reference_muscle as reference_muscle,
    simulate as simulate,
)
