from .finished import CampaignChanged as CampaignChanged
from .plots import plot_table as plot_table
from .run import process as process
from .table import Table as Table
from .tiles import Tile as Tile, contact_sheet as contact_sheet
from .workers import WorkerDied as WorkerDied
