"""Bootstrap: the same draws whatever their number, and what cannot be drawn."""

import numpy as np
import pytest

from fitting import Identification, InputError
from fitting.uncertainty import bootstrap


def test_more_replicates_begin_with_the_same(fitted20: Identification) -> None:
    """In chunks of 250, of which the last may be short."""
    told = []
    fewer = bootstrap(fitted20, 250, seed=3)
    more = bootstrap(fitted20, 260, seed=3, progress=lambda *of: told.append(of))
    assert not fewer.failed
    np.testing.assert_array_equal(fewer.samples, more.samples[:250])
    np.testing.assert_array_equal(fewer.forces, more.forces[:250])
    assert told == [(250, 260), (260, 260)]


def test_whole_lengths_are_drawn(fitted20: Identification) -> None:
    found = bootstrap(fitted20, 20, resample="length")
    assert found.samples.shape == (20 - found.failed, len(found.names))
    with pytest.raises(InputError, match="resample is one of residual, length, specimen"):
        bootstrap(fitted20, resample="colour")
    with pytest.raises(InputError, match="needs three or more of them, got 1"):
        bootstrap(fitted20, resample="specimen")
