from .cached_steps import FolderStep as FolderStep, run_steps as run_steps
from .cross_checks import (
    Check as Check,
    checks_table as checks_table,
    read_checks as read_checks,
    settle as settle,
)
from .evaluation import GEOMETRIES as GEOMETRIES, evaluation_steps as evaluation_steps
from .report import first_run as first_run, report_step as report_step
from .sheet import (
    RESULTS as RESULTS,
    SHEET as SHEET,
    SKELETON as SKELETON,
    Sheet as Sheet,
    read_sheet as read_sheet,
)
