"""Bootstrap: the same draws whatever their number, and what cannot be drawn."""

import numpy as np

from fitting import Identification
from fitting.validation import bootstrap


def test_more_replicates_begin_with_the_same(fitted20: Identification) -> None:
    """In chunks of 250, of which the last may be short."""
    told = []
    fewer = bootstrap(fitted20, 250, seed=3)
    more = bootstrap(fitted20, 260, seed=3, progress=lambda *of: told.append(of))
    assert not fewer.failed
    np.testing.assert_array_equal(fewer.samples, more.samples[:250])
    np.testing.assert_array_equal(fewer.forces, more.forces[:250])
    assert told == [(250, 260), (260, 260)]
