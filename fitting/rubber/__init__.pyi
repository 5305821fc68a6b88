from .cyclic_record import CyclicRecord as CyclicRecord
from .hysteresis import (
    FrictionFit as FrictionFit,
    fit_pressure_friction as fit_pressure_friction,
    fit_thread_friction as fit_thread_friction,
)
from .in_situ import InSitu as InSitu, ModulusFit as ModulusFit, thread_in_situ as thread_in_situ
from .loop import HysteresisLoop as HysteresisLoop, hysteresis_loop as hysteresis_loop
from .tensile import (
    BladderCharacterisation as BladderCharacterisation,
    TensileFit as TensileFit,
    characterise_bladder as characterise_bladder,
)
from .tensile_cycle import TensileCycle as TensileCycle
from .tensile_record import TensileRecord as TensileRecord
from .thread_fit import ThreadFit as ThreadFit, fit_thread as fit_thread
