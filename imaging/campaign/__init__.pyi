from .machine_log import MachineLog as MachineLog, read_machine_log as read_machine_log
from .plots import plot_table as plot_table
from .run import process as process
from .shards import CampaignChanged as CampaignChanged
from .sync import Synchronisation as Synchronisation, synchronise as synchronise
from .table import Table as Table
from .tiles import Tile as Tile, contact_sheet as contact_sheet
from .workers import WorkerDied as WorkerDied
