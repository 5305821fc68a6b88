from .check_pictures import write_check_pictures as write_check_pictures
from .contact_sheet import Tile as Tile, contact_sheet as contact_sheet
from .isobaric_analysis import Analysis as Analysis, analyse as analyse
from .isobaric_figures import figures as figures, table_rows as table_rows
from .isobaric_pictures import plot_characterisation as plot_characterisation
from .photographs import (
    LOG_OF_PICTURES as LOG_OF_PICTURES,
    CampaignOutcome as CampaignOutcome,
    as_document as as_document,
    measure_pictures as measure_pictures,
    with_log as with_log,
)
from .picture_files import expand as expand
from .recipes import parse_scale as parse_scale, picture_recipe as picture_recipe
from .simulation import (
    SimulatedTest as SimulatedTest,
    Watcher as Watcher,
    reference_muscle as reference_muscle,
    simulate as simulate,
    simulated_muscle as simulated_muscle,
)
from .table_plot import plot_table as plot_table
