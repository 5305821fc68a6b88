from .mjx_step import pulled as pulled
from .mujoco_callback import install as install
from .opensim import ideal_braid as ideal_braid
from .plain import TabulatedPull as TabulatedPull
from .subject import Subject as Subject, made_by as made_by, read_subject as read_subject
from .tabulate import TableErrors as TableErrors, table_errors as table_errors, tabulated as tabulated
from .targets import TARGETS as TARGETS, Target as Target, export as export
