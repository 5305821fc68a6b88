from .check_pictures import choose as choose, write_check_pictures as write_check_pictures
from .columns import column_name as column_name
from .finished import PARTS as PARTS, CampaignChanged as CampaignChanged
from .picture_files import expand as expand
from .plots import plot_table as plot_table
from .row import (
    POSITION as POSITION,
    Row as Row,
    WorkerDied as WorkerDied,
    measured_rows as measured_rows,
)
from .run import process as process
from .table import Table as Table
from .tiles import Tile as Tile, contact_sheet as contact_sheet
