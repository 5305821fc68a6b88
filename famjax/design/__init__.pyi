from .catalogue import (
    Catalogue as Catalogue,
    CatalogueBladder as CatalogueBladder,
    CatalogueBraid as CatalogueBraid,
    CatalogueTube as CatalogueTube,
    EndFitting as EndFitting,
    fitting_diameter_on_bladder as fitting_diameter_on_bladder,
    fitting_diameter_on_braid as fitting_diameter_on_braid,
    load_catalogue as load_catalogue,
    size_end_fittings as size_end_fittings,
    swaged_bore as swaged_bore,
)
from .report import (
    design_card as design_card,
    design_document as design_document,
    design_rows as design_rows,
    exclusion_rows as exclusion_rows,
    feasible_table as feasible_table,
    summary as summary,
)
from .search import (
    OBJECTIVES as OBJECTIVES,
    BuildablePair as BuildablePair,
    Combination as Combination,
    Requirement as Requirement,
    Search as Search,
    costs_of as costs_of,
    fam_angle as fam_angle,
    front_members as front_members,
    search as search,
)
