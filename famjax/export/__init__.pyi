from .closed_form import ClosedForm as ClosedForm, closed_form as closed_form
from .mujoco import (
    CompiledPlant as CompiledPlant,
    CompiledPull as CompiledPull,
    install as install,
    mjx_step as mjx_step,
    uninstall as uninstall,
)
from .plain import TabulatedPull as TabulatedPull
from .table import (
    Subject as Subject,
    TableErrors as TableErrors,
    made_of as made_of,
    read_subject as read_subject,
    tabulated as tabulated,
)
from .targets import TARGETS as TARGETS, export as export
