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
from .space_search import (
    Exclusion as Exclusion,
    SpaceSearch as SpaceSearch,
    search_space as search_space,
)
