"""Promises of the posterior: chains that agree, in time, and ranks of the truth that are uniform."""

import time
from typing import Any

import calibration
from promise import Case, Promise
from promises_fits import A1, LOADED, fit

import fitting

ISSUE = 14
_LIMIT = 0.05
_TRUTHS = 200


def _sampled(case: Case) -> tuple[fitting.posterior.Posterior, float]:
    """The posterior of the standard fit, and its CPU seconds once it is compiled."""

    def compute() -> tuple[fitting.posterior.Posterior, float]:
        result = fit(case)
        fitting.sample(result, seed=1)
        begin = time.process_time()
        posterior = fitting.sample(result)
        return posterior, time.process_time() - begin

    return case.once("posterior", compute)


def _calibration(censored: bool) -> Any:
    """Smallest p of the ranks times the number of parameters."""

    def measure(case: Case) -> float:
        del case
        p = calibration.uniformity(calibration.ranks(_TRUTHS, 0, censored=censored))
        return min(p.values()) * len(p)

    return measure


_CALL = "fitting.sample(fitting.identify(data))"
_TRUTH = "python benchmarks/calibration.py"

POSTERIOR: tuple[Promise, ...] = (
    Promise(ISSUE, "posterior, R-hat", lambda case: _sampled(case)[0].r_hat, _CALL, A1, LOADED,
            "largest R-hat", 1.01, seed=0),
    Promise(ISSUE, "posterior, effective size", lambda case: _sampled(case)[0].effective_size, _CALL,
            A1, LOADED, "smallest effective size, bulk and tails", 400.0, "at least", seed=0),
    Promise(ISSUE, "posterior, CPU time", lambda case: _sampled(case)[1], _CALL, A1,
            "after compilation", "CPU time [s]", 20.0, seed=0),
    Promise(ISSUE, "posterior, calibration", _calibration(False), _TRUTH, "200 truths from the prior",
            "loaded readings", "smallest p of uniform ranks x parameters", _LIMIT, "at least", seed=0,
            cost="long"),
    Promise(ISSUE, "posterior, calibration with censored readings", _calibration(True),
            f"{_TRUTH} --censored", "200 truths from the prior", "slack and saturated ones too",
            "smallest p of uniform ranks x parameters", _LIMIT, "at least", seed=0, cost="long"),
)  # fmt: skip
