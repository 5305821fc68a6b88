from .check_pictures import write_check_pictures as write_check_pictures
from .columns import column_name as column_name
from .picture_files import expand as expand
from .plots import plot_table as plot_table
from .run import process as process
from .shards import CampaignChanged as CampaignChanged
from .table import Table as Table
from .tiles import Tile as Tile, contact_sheet as contact_sheet
from .workers import WorkerDied as WorkerDied
