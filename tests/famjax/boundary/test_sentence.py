"""Sentences whose quantities follow the reader's units."""

import json
import pickle

import pytest

from famjax.boundary.errors import InputError
from famjax.boundary.sentence import Quantity, Sentence, told_in

INNER = Sentence("the length ", Quantity(0.25, "length"))
WHOLE = Sentence("It seems that ", INNER, " pulls ", Quantity(44.4822, "force", 3), ".")


@pytest.mark.parametrize(
    ("system", "told"),
    [
        ("metric", "It seems that the length 250 mm pulls 44.5 N."),
        ("us", "It seems that the length 9.843 in pulls 10 lbf."),
        ("si", "It seems that the length 0.25 m pulls 44.5 N."),
    ],
)
def test_quantities_follow_the_units_also_in_a_sentence_within(system: str, told: str) -> None:
    assert told_in(WHOLE, system) == told
    assert told_in(told, "us") == told  # a text has no quantities to change


def test_as_it_stands_it_is_a_metric_text() -> None:
    assert told_in(WHOLE, "metric") == WHOLE
    assert json.loads(json.dumps([WHOLE])) == [WHOLE]
    assert told_in(pickle.loads(pickle.dumps(WHOLE)), "us") == told_in(WHOLE, "us")
    with pytest.raises(InputError, match="units must be one of"):
        told_in(WHOLE, "imperial")
