"""Whether the verdict of `famjax fit` tells wrong files from sound ones, and names what is wrong.

    python benchmarks/wrong_files.py [--data MAP ...] [--seed 0] [--sound 20] [--each] [--json FILE]

Every mistake of `file_faults.py` is made in a sound map, written as a CSV file, and read, fitted and
judged as bare `famjax fit FILE` does it; so are the sound maps themselves. Sound are the bundled
maps, those of `--data` (CSV files or folders of them, of any muscle), and random muscles with and
without noise up to the number asked for. A file that is refused, with a sentence, counts as one in
which nothing is identified. `--each` makes every mistake in every map.
"""

import argparse
import dataclasses
import json
import re
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import jax
import numpy as np
from file_faults import FAULTS, Fault, Sheet
from sound_maps import random_map

import fitting
from famjax.boundary.errors import InputError
from fitting import ForceData
from fitting.cli.problem import judged as judgement_of
from fitting.evidence import Evidence

MUST_SHOW = ("units", "absolute", "sign", "mixed", "outliers", "thick wall", "wrong bore")
"""Kinds of mistakes all of which must end in exit code 1."""


@dataclasses.dataclass(frozen=True)
class Row:
    """What came of a file.

    Attributes:
        file: the map, and the mistake made in it.
        kind: of mistake; "sound" where none was made.
        level: of the verdict, or "refused".
        misfit: of the fit in % of the largest force, nan where there is none.
        told: suspicions, or the refusal.
        right: whether the verdict is, see `MUST_SHOW`.
        named: whether the mistake is named; of a sound map, whether any is.
        seconds: for all of it.
    """

    file: str
    kind: str
    level: str
    misfit: float
    told: str
    right: bool
    named: bool
    seconds: float


def judged(path: Path) -> tuple[str, float, str]:
    """Level, misfit [%] and suspicions of a file, as bare `famjax fit` has them."""
    try:
        choice = fitting.choose(fitting.read_csv(path), starts=16, seed=0)
        judgement = judgement_of(
            choice.chosen, choice, Evidence(left_out=choice.left_out), lambda *_: None
        )
    except InputError as error:
        return "refused", np.nan, str(error)
    told = " ".join(one.sentence for one in judgement.suspicions)
    return judgement.level, choice.chosen.errors.rmse_percent, told


def row(path: Path, data: ForceData, fault: Fault | None) -> Row:
    """The outcome of one file."""
    start = time.perf_counter()
    level, misfit, told = judged(path)
    name = data.specimen.name if fault is None else f"{data.specimen.name}: {fault.name}"
    named = bool(told) if fault is None else bool(re.search(fault.cause, told))
    return Row(
        name, "sound" if fault is None else fault.kind, level, misfit, told,
        _right(level, fault), named, time.perf_counter() - start,
    )  # fmt: skip


def _right(level: str, fault: Fault | None) -> bool:
    """Whether a verdict is that of a file with this mistake; one length off is a doubt at least."""
    if fault is not None and fault.kind == "length":
        return level != "identified"
    return (level in ("refused", "not identified")) == (fault is not None)


def sound_maps(given: Sequence[str], count: int, seed: int) -> list[ForceData]:
    """Bundled maps, given ones, and random ones up to a number."""
    found = [fitting.load_bundled(name) for name in fitting.bundled_names()]
    for path in map(Path, given):
        files = sorted(path.glob("*.csv")) if path.is_dir() else [path]
        found += [fitting.read_csv(file) for file in files]
    return found + [random_map(1000 * seed + k) for k in range(max(0, count - len(found)))]


def wrong_files(
    maps: Sequence[ForceData], seed: int, *, each: bool = False
) -> Iterator[tuple[ForceData, Fault, Sheet]]:
    """Every mistake in a map that it can be made in, or in all of these."""
    for number, fault in enumerate(FAULTS):
        random = np.random.default_rng((seed, number))
        for k in random.permutation(len(maps)):
            sheet = Sheet.of(maps[k], maps[(k + 1) % len(maps)])
            if not fault.possible(sheet):
                continue
            fault.change(sheet, random)
            yield maps[k], fault, sheet
            if not each:
                break


def rows(given: Sequence[str], count: int, seed: int, *, each: bool = False) -> Iterator[Row]:
    """The outcomes of the sound maps, then those of the wrong files."""
    maps = sound_maps(given, count, seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.csv"
        for data in maps:
            path.write_text(Sheet.of(data).text(), encoding="utf-8")
            yield row(path, data, None)
        for data, fault, sheet in wrong_files(maps, seed, each=each):
            path.write_text(sheet.text(), encoding="utf-8")
            yield row(path, data, fault)


def summary(found: Sequence[Row]) -> dict[str, float]:
    """The figures that are promised."""
    sound = [one for one in found if one.kind == "sound"]
    wrong = [one for one in found if one.kind in MUST_SHOW]
    return {
        "sound maps": len(sound),
        "sound maps that end 1": sum(not one.right for one in sound),
        "sound maps with a false cause": sum(one.named for one in sound),
        "wrong files": len(wrong),
        "wrong files that end 0": sum(not one.right for one in wrong),
        "wrong files whose cause is named, part": sum(one.named for one in wrong)
        / max(1, len(wrong)),
        "longest time [s]": max(one.seconds for one in found),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line for each file, and the sums."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--data", nargs="+", default=[], metavar="MAP", help="further sound maps")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sound", type=int, default=20, help="number of sound maps")
    parser.add_argument("--each", action="store_true", help="every mistake in every map")
    parser.add_argument("--json", type=Path, help="file for the rows")
    given = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    found = []
    for one in rows(given.data, given.sound, given.seed, each=given.each):
        found.append(one)
        mark = "right" if one.right else "WRONG"
        named = "named" if one.named else "-"
        print(
            f"{one.file:55.55} {one.level:22} {one.misfit:9.3g} % {mark:5} {named:5} "
            f"{one.seconds:5.1f} s {'' if one.named == (one.kind != 'sound') else one.told}",
            flush=True,
        )
    for name, value in summary(found).items():
        print(f"{name}: {value:.4g}")
    if given.json:
        given.json.write_text(json.dumps([dataclasses.asdict(one) for one in found], indent=1))
    return int(any(not one.right for one in found if one.kind in ("sound", *MUST_SHOW)))


if __name__ == "__main__":
    sys.exit(main())
