from .catalogue import (
    Catalogue as Catalogue,
    CatalogueBladder as CatalogueBladder,
    CatalogueBraid as CatalogueBraid,
    CatalogueError as CatalogueError,
    CatalogueTube as CatalogueTube,
    load_catalogue as load_catalogue,
)
from .combination import (
    Combination as Combination,
    Feasibility as Feasibility,
    fam_angle as fam_angle,
    feasibility as feasibility,
    safety_factor as safety_factor,
    thread_strength_margin as thread_strength_margin,
)
from .report import (
    design_document as design_document,
    design_picture as design_picture,
    design_rows as design_rows,
    end_fitting_rows as end_fitting_rows,
    exclusion_rows as exclusion_rows,
    feasible_table as feasible_table,
    summary as summary,
    tube_buckling_rows as tube_buckling_rows,
)
from .search import (
    OBJECTIVES as OBJECTIVES,
    BuildablePair as BuildablePair,
    Requirement as Requirement,
    Search as Search,
    costs_of as costs_of,
    front_members as front_members,
    search as search,
)
from .swage import (
    EndFitting as EndFitting,
    TubeStrength as TubeStrength,
    assumption_notes as assumption_notes,
    bladder_compression as bladder_compression,
    braid_compression as braid_compression,
    compression_sensitivity as compression_sensitivity,
    euler_load as euler_load,
    fitting_diameter_on_bladder as fitting_diameter_on_bladder,
    fitting_diameter_on_braid as fitting_diameter_on_braid,
    size_end_fittings as size_end_fittings,
    stepped_column_gain as stepped_column_gain,
    support_stiffness as support_stiffness,
    swaged_bore as swaged_bore,
    swaged_thickness as swaged_thickness,
    tube_second_moment as tube_second_moment,
    tube_strengths as tube_strengths,
    yield_load as yield_load,
)
