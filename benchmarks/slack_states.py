"""Whether what is said of a slack muscle is true: it pulls nothing.

    python benchmarks/slack_states.py [--data MAP ...] [--json FILE]

Each map is fitted as bare `famjax fit` does it, saved and read back. Then its slack readings are
predicted, as are rest length without pressure and lengths far beyond the braid's limits. Maps are
the bundled ones and those of `--data`, CSV files or folders of them.
"""

import argparse
import dataclasses
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np

import fitting
from fitting import Choice, ForceData
from fitting.evidence import Evidence
from fitting.saved import SavedFit

FAR = (0.2, 0.4, 1.2)
"""Lengths, in parts of the rest length, at which no muscle with a braid can be."""


@dataclasses.dataclass(frozen=True)
class SlackStates:
    """What is predicted of the slack states of a map.

    Attributes:
        name: of the map.
        readings: number of slack readings.
        contained: of these, whose 95 % band contains 0 N.
        zero: of these, of which 0 N is predicted, by the model alone.
        largest: pull [N] of the model at a slack reading, at most; 0 where it pulls at none.
        at_rest: force [N] at rest length without pressure.
        far: number of forces that are given at `FAR`.
    """

    name: str
    readings: int
    contained: int
    zero: int
    largest: float
    at_rest: float
    far: int


def slack_states(fit: SavedFit, data: ForceData) -> SlackStates:
    """What a saved fit says of the slack readings of its map, of rest, and of far lengths."""
    slack, rest = data.slack, data.specimen.rest_length
    rows = fitting.prediction.static_rows(fit, data.length[slack], data.pressure[slack])
    (at_rest,) = fitting.predict(fit, np.array([rest]), np.zeros(1))
    far = fitting.predict(fit, rest * np.array(FAR), np.array([0.0, data.pressure.max()]))
    return SlackStates(
        name=data.specimen.name,
        readings=len(rows),
        contained=sum(_contains_zero(row) for row in rows),
        zero=sum(row["force_N"] == 0 for row in rows),
        largest=max((row["force_N"] or 0.0 for row in rows), default=0.0),
        at_rest=np.nan if at_rest["force_N"] is None else at_rest["force_N"],
        far=sum(row["force_N"] is not None for row in far),
    )


def _contains_zero(row: dict) -> bool:
    return row["low_95_N"] is not None and row["low_95_N"] <= 0 <= row["high_95_N"]


def saved(choice: Choice) -> SavedFit:
    """A choice as `famjax predict` has it."""
    with tempfile.TemporaryDirectory() as folder:
        evidence = Evidence(error=choice.error)
        fitting.write_fit(choice.chosen, Path(folder), evidence=evidence, choice=choice)
        return fitting.load_fit(Path(folder) / "fit.json")


def given_maps(paths: Sequence[str]) -> list[ForceData]:
    """The bundled maps, and those in files and folders."""
    found = [fitting.load_bundled(name) for name in fitting.bundled_names()]
    for path in map(Path, paths):
        files = sorted(path.glob("*.csv")) if path.is_dir() else [path]
        found += [fitting.read_csv(file) for file in files]
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line for each map; 1 where a band lacks 0 N, rest pulls, or a far length has a force."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--data", nargs="+", default=[], metavar="MAP", help="further maps")
    parser.add_argument("--json", type=Path, help="file for the rows")
    given = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    found = []
    for data in given_maps(given.data):
        one = slack_states(saved(fitting.choose(data, starts=16, seed=0)), data)
        found.append(one)
        print(
            f"{one.name:24.24} {one.contained} of {one.readings} bands contain 0 N, {one.zero} are of "
            f"0 N; the model pulls with {one.largest:.3g} N at most; at rest {one.at_rest:.3g} N; "
            f"{one.far} forces far beyond the braid's limits",
            flush=True,
        )
    if given.json:
        given.json.write_text(json.dumps([dataclasses.asdict(one) for one in found], indent=1))
    wrong = [one for one in found if one.contained < one.readings or one.at_rest != 0 or one.far]
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
