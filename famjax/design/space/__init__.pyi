from .front import (
    costs_of as costs_of,
    front_members as front_members,
)
from .limits import (
    OBJECTIVES as OBJECTIVES,
    SearchLimits as SearchLimits,
    SearchRanges as SearchRanges,
)
from .pairs import BuildablePair as BuildablePair
from .refinement import Refinement as Refinement
from .search_picture import search_picture as search_picture
from .search_rows import (
    design_rows as design_rows,
    exclusion_rows as exclusion_rows,
    feasible_table as feasible_table,
    refinement_rows as refinement_rows,
    search_document as search_document,
    summary as summary,
)
from .space_search import (
    Exclusion as Exclusion,
    SpaceSearch as SpaceSearch,
    search_space as search_space,
)
