"""`famjax card`."""

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ..loading import load_fitting, look_here, warn_unidentified
from ..options.whole_numbers import Seed


def card(
    fit_json: Path,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    name: str | None = None,
    sample: int = 32,
    seed: Seed = 0,
    json_: bool = False,
) -> int:
    """Write the muscle card of a fit: what a simulator, a controller or a colleague needs of it.

    A card holds the muscle, the lengths and pressures of the data, the volume of the fluid, the
    errors, a sample of muscles, the hysteresis where it was fitted, and where all of it comes from.
    `famjax.cards.read_card` reads it; its `safe()` may be taken beyond the data.

    Parameters
    ----------
    fit_json
        A `fit.json` that `famjax fit` has written.
    output
        The card's file; `card.json` beside the fit unless given.
    name
        Of the muscle; the specimen's unless given.
    sample
        Number of muscles drawn from the fit's errors, 0 for none.
    seed
        Of the sample.
    json_
        Print the card to standard output too, and nothing else there.
    """
    load_fitting()
    from famjax.boundary.origin import Origin
    from famjax.cards import write_card
    from fitting.saved import card_of, load_fit

    look_here()
    found = card_of(
        load_fit(fit_json), name=name, count=sample, seed=seed, origin=Origin.of_this_command()
    )
    warn_unidentified(fit_json, found.provenance.verdict, found.provenance.reasons)
    path = write_card(found, fit_json.parent / "card.json" if output is None else output)
    if json_:
        print(json.dumps(json.loads(path.read_text(encoding="utf-8")), allow_nan=False))
        return 0
    print(f"{found.name}: {len(found.members)} model(s), RMSE {found.provenance.rmse_N:.3g} N")
    for note in found.safe().notes:
        print(f"note: {note}")
    if found.draws is None:
        print("note: no sample of muscles, as the fit has no standard errors or none was wanted")
    print(f"written: {path}")
    return 0
