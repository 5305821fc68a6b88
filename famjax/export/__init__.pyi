from .mjx_model import mjx_step as mjx_step
from .mujoco_callback import CompiledPull as CompiledPull, install as install
from .opensim import ideal_braid as ideal_braid
from .plain import TabulatedPull as TabulatedPull
from .subject import Subject as Subject, made_of as made_of, read_subject as read_subject
from .tabulate import (
    TableErrors as TableErrors,
    table_errors as table_errors,
    tabulated as tabulated,
)
from .targets import TARGETS as TARGETS, export as export
