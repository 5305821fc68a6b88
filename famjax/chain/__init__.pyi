from .isobaric_test import Analysis as Analysis, analyse as analyse
from .photographs import (
    Outcome as Outcome,
    as_document as as_document,
    measure_pictures as measure_pictures,
    with_log as with_log,
)
from .simulated_test import SimulatedTest as SimulatedTest, simulate as simulate
from .test_pictures import plot_characterisation as plot_characterisation
from .test_table import figures as figures, table_rows as table_rows
