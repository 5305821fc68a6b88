from .isobaric_analysis import Analysis as Analysis, analyse as analyse
from .isobaric_figures import figures as figures, table_rows as table_rows
from .isobaric_pictures import plot_characterisation as plot_characterisation
from .photographs import (
    LOG_OF_PICTURES as LOG_OF_PICTURES,
    Outcome as Outcome,
    as_document as as_document,
    measure_pictures as measure_pictures,
    with_log as with_log,
)
from .recipes import parse_scale as parse_scale, picture_recipe as picture_recipe
from .simulation import (
    SimulatedTest as SimulatedTest,
    Watcher as Watcher,
    reference_muscle as reference_muscle,
    simulate as simulate,
    simulated_muscle as simulated_muscle,
)
