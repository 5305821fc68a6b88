"""The verdict on a series: whether one model holds for all of its specimens."""

from collections.abc import Sequence

from famjax.boundary.sentence import Quantity, Sentence

from ..evidence.left_out import LeftOut
from ..result import Identification
from .judgement import POOR, Judgement, of_bounds, of_ridges, unchecked

_FOREIGN = 15.0  # % of its largest force: specimens of one series do not differ by so much


def judge_series(specimens: Sequence[Identification], left_out: LeftOut) -> Judgement:
    """The verdict on one model of several muscles that differ in length.

    Specimens of one make differ by more than a muscle is missed by alone, so that a series is held to
    less than one muscle is, see `judge`; by how much they differ is said, and is in the bands.

    Args:
        specimens: the identification of each, with shared parameters.
        left_out: errors on each specimen while it was left out.
    """
    grave: list[str] = []
    doubts: list[str] = []
    first = specimens[0]
    if not first.converged:
        grave.append(
            "The fit did not converge: its numbers are not an optimum. Try more starts (starts=) or "
            "one plain law (--law linear)."
        )
    missed = [one.errors.rmse_percent for one in specimens]
    worst = max(range(len(specimens)), key=lambda k: missed[k])
    name = specimens[worst].data.specimen.name
    if not missed[worst] <= _FOREIGN:
        grave.append(
            f"The model of all misses {name} by {missed[worst]:.3g} % of its largest force; specimens of "
            f"one series differ by less than {_FOREIGN:g} %. Its map is of another make of muscle, or "
            "wrong: see what famjax fit says of it alone, and leave it out."
        )
    elif missed[worst] > POOR:
        predicted = left_out.group_rmse
        most = int(predicted.argmax())
        other = specimens[most].data.specimen.name
        doubts.append(
            Sentence(
                f"The specimens differ: the model of all misses {name} by {missed[worst]:.3g} % of its "
                f"largest force; predicted from the others, {other} is missed by ",
                Quantity(float(predicted[most]), "force", 3),
                ". A muscle never measured differs as much; the band of its prediction says so.",
            )
        )
    doubts += [*of_bounds(first), *of_ridges(first)]
    reasons = (*grave, *doubts)
    if grave:
        return Judgement("not identified", reasons, unchecked=unchecked(first))
    unsure = doubts or any("rest_length" in one.data.assumed for one in specimens)
    level = "identified with doubts" if unsure else "identified"
    return Judgement(level, reasons, unchecked=unchecked(first))
