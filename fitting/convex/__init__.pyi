from .qp import Optimum as Optimum, Status as Status, solve_qp as solve_qp
