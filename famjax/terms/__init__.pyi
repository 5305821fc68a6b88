from .abstract_term import AbstractForceTerm as AbstractForceTerm, SumOfTerms as SumOfTerms
from .bladder_wall import (
    BladderAxial as BladderAxial,
    BladderHoop as BladderHoop,
    BladderWall as BladderWall,
    bladder_axial_force as bladder_axial_force,
    bladder_hoop_force as bladder_hoop_force,
)
from .centred_slip import (
    CentredSlip as CentredSlip,
    ReferenceCycle as ReferenceCycle,
    there_and_back as there_and_back,
)
from .friction import (
    AbstractFriction as AbstractFriction,
    Friction as Friction,
    PressureFriction as PressureFriction,
    ThreadFriction as ThreadFriction,
    crossing_area as crossing_area,
    smooth_sign as smooth_sign,
    thread_contact_area as thread_contact_area,
)
from .maxwell_slip import MaxwellSlip as MaxwellSlip, SlipState as SlipState
from .pressurised_braid import PressurisedBraid as PressurisedBraid
from .slip_elements import (
    SlipElements as SlipElements,
    slip as slip,
    slip_coordinates as slip_coordinates,
    slip_shares as slip_shares,
)
from .spring import Spring as Spring
from .virtual_work import (
    PressureTerms as PressureTerms,
    VirtualWork as VirtualWork,
    pressure_terms as pressure_terms,
    virtual_work_force as virtual_work_force,
    volume_rate as volume_rate,
)
