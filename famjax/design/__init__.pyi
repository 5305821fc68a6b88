from .catalogue import (
    Catalogue as Catalogue,
    CatalogueBladder as CatalogueBladder,
    CatalogueBraid as CatalogueBraid,
    CatalogueError as CatalogueError,
    CatalogueTest as CatalogueTest,
    CatalogueTube as CatalogueTube,
)
from .catalogue_file import load_catalogue as load_catalogue
from .catalogue_search import (
    DesignCandidate as DesignCandidate,
    Failure as Failure,
    Requirement as Requirement,
    search as search,
)
from .combination import (
    Combination as Combination,
    Feasibility as Feasibility,
    bladder_material as bladder_material,
    fam_angle as fam_angle,
    feasibility as feasibility,
)
from .design_rows import (
    braid_angle_rows as braid_angle_rows,
    candidate_rows as candidate_rows,
    end_fitting_rows as end_fitting_rows,
    geometry_rows as geometry_rows,
    performance_rows as performance_rows,
    safety_factor_rows as safety_factor_rows,
    tube_buckling_rows as tube_buckling_rows,
)
from .end_fitting import (
    EndFitting as EndFitting,
    bladder_compression as bladder_compression,
    braid_compression as braid_compression,
    compression_sensitivity as compression_sensitivity,
    fitting_diameter_on_bladder as fitting_diameter_on_bladder,
    fitting_diameter_on_braid as fitting_diameter_on_braid,
    size_end_fittings as size_end_fittings,
    swaged_bore as swaged_bore,
    swaged_thickness as swaged_thickness,
)
from .safety import (
    SafetyFactor as SafetyFactor,
    safety_factor as safety_factor,
    safety_factors as safety_factors,
    thread_strength_margin as thread_strength_margin,
)
from .space import (
    BuildablePair as BuildablePair,
    Exclusion as Exclusion,
    Refinement as Refinement,
    SearchLimits as SearchLimits,
    SearchRanges as SearchRanges,
    SpaceSearch as SpaceSearch,
    search_space as search_space,
)
from .swage_tube import (
    TubeBuckling as TubeBuckling,
    TubeOptions as TubeOptions,
    TubeStrength as TubeStrength,
    assumption_notes as assumption_notes,
    euler_load as euler_load,
    stepped_column_gain as stepped_column_gain,
    support_stiffness as support_stiffness,
    tube_buckling as tube_buckling,
    tube_second_moment as tube_second_moment,
    tube_strengths as tube_strengths,
    yield_load as yield_load,
)
