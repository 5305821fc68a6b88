"""Design of a muscle: braids, bladders and tubes on offer, what they make, and the end-fittings.

A namespace of public names, like `famjax.units`; the code is in the private modules.
"""

from ._catalogue import (
    Catalogue as Catalogue,
    CatalogueBladder as CatalogueBladder,
    CatalogueBraid as CatalogueBraid,
    CatalogueError as CatalogueError,
    CatalogueTube as CatalogueTube,
    load_catalogue as load_catalogue,
)
from ._design import (
    Candidate as Candidate,
    Combination as Combination,
    Failure as Failure,
    Feasibility as Feasibility,
    Requirement as Requirement,
    fam_angle as fam_angle,
    feasibility as feasibility,
    search as search,
)
from ._design_report import (
    braid_angle_rows as braid_angle_rows,
    candidate_rows as candidate_rows,
    end_fitting_rows as end_fitting_rows,
    geometry_rows as geometry_rows,
    jamming_range_rows as jamming_range_rows,
    performance_rows as performance_rows,
)
from ._end_fitting import (
    EndFitting as EndFitting,
    TubeBuckling as TubeBuckling,
    bladder_compression as bladder_compression,
    braid_compression as braid_compression,
    compression_sensitivity as compression_sensitivity,
    euler_load as euler_load,
    fitting_diameter_on_bladder as fitting_diameter_on_bladder,
    fitting_diameter_on_braid as fitting_diameter_on_braid,
    safety_factor as safety_factor,
    size_end_fittings as size_end_fittings,
    swaged_bore as swaged_bore,
    swaged_thickness as swaged_thickness,
    tube_buckling as tube_buckling,
    tube_second_moment as tube_second_moment,
)
