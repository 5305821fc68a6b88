from .columns import column_name as column_name
from .finished import PARTS as PARTS, CampaignChanged as CampaignChanged
from .row import (
    POSITION as POSITION,
    Row as Row,
    WorkerDied as WorkerDied,
    measured_rows as measured_rows,
)
from .run import process as process
from .table import Table as Table
