"""Force maps: what of them is slack."""

import dataclasses

import numpy as np

from fitting import ForceData


def test_noise_about_zero_is_slack(dmsp10: ForceData) -> None:
    noise = np.random.default_rng(1).normal(0, 0.5, dmsp10.force.size)
    noisy = dataclasses.replace(dmsp10, force=dmsp10.force + noise, slack_below=None, count=None)
    np.testing.assert_array_equal(noisy.slack, dmsp10.slack)
    assert "count as slack: readings below zero show that much noise" in noisy.notes[-1]
    pushing = dataclasses.replace(
        dmsp10, force=np.where(dmsp10.slack, -30.0, dmsp10.force), slack_below=None, count=None
    )
    assert pushing.slack_below == 0.0
