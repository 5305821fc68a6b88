from .isobaric_test import Analysis as Analysis, analyse as analyse
from .simulated_test import SimulatedTest as SimulatedTest, simulate as simulate
from .test_pictures import plot_characterisation as plot_characterisation
from .test_table import figures as figures, table_rows as table_rows
