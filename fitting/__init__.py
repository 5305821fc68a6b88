"""Identification of fluidic artificial muscles: data with units in, a certified model out."""

from ._csv import (
    bundled_names as bundled_names,
    load_bundled as load_bundled,
    read_csv as read_csv,
)
from ._data import ForceData as ForceData, Specimen as Specimen
from ._errors import InputError as InputError
from ._identify import identify as identify
from ._parameters import Bounds as Bounds, default_bounds as default_bounds
from ._problem import Problem as Problem, build_problem as build_problem
from ._qp import Optimum as Optimum, Status as Status, solve_qp as solve_qp
from ._result import (
    Certificate as Certificate,
    Errors as Errors,
    Estimate as Estimate,
    Identification as Identification,
)

__famjax__ = "0.1.0"
