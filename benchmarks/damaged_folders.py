"""Whether the evaluation of a damaged folder stops at the right step with the right message.

    python benchmarks/damaged_folders.py [--seed 3] [--only TEXT] [--json FILE]

A small twin is made and its pictures are measured; then each mistake of `folder_damages.py` is made
in a copy in its place, and `famjax characterise FOLDER --only records --only pictures --only shape`
is run.
"""

import argparse
import contextlib
import io
import json
import re
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import jax
from folder_damages import DAMAGES, Damage, Others

from famjax.__main__ import main as famjax

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from rendering.folder import write_twin

STEPS = ("records", "pictures", "shape")
_EXACT = """\
[errors]
rest_length_m = 0.0
wall_thickness_m = 0.0
bladder_diameter_m = 0.0
braid_thickness_m = 0.0
"""
"""A laboratory whose sheet is right, so that what is changed in it is what is wrong."""
_ANOTHER_TEST = "[rig]\npressures_psi = [30, 60, 90]\nstroke_in = 1.9\nrate_in_per_s = 0.08\n"
_ANOTHER_MUSCLE = "[muscle]\nrest_length_in = 8.5\nbladder_diameter_in = 1.0\n"
_FEW = "[camera]\npictures = {}\n"


def run(*words: object) -> tuple[int, str]:
    """Exit code and standard error of a command."""
    said = io.StringIO()
    code = 0
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            famjax([*map(str, words)])
        except SystemExit as stop:
            code = int(stop.code or 0)
    return code, said.getvalue()


def prepared(place: Path, seed: int) -> tuple[Path, Others]:
    """A sound folder with its results, and others that files are taken from."""
    folder = place / "muscle"
    others = Others(place / "test", place / "other")
    for path, text in ((others.test, _ANOTHER_TEST + _FEW.format(2)),
                       (others.muscle, _ANOTHER_MUSCLE + _FEW.format(12))):  # fmt: skip
        truth = path.with_suffix(".toml")
        truth.write_text(text)
        write_twin(path, seed=seed + 1, flawed=False, truth=truth)
    exact = place / "exact.toml"
    exact.write_text(_EXACT)
    write_twin(folder, seed=seed, flawed=False, truth=exact)
    code, said = evaluated(folder)
    assert not code, said
    assert "warning" not in said, said
    sound = place / "sound"
    shutil.copytree(folder, sound)
    return sound, others


def evaluated(folder: Path) -> tuple[int, str]:
    """The steps of a folder before its fits."""
    steps = [word for step in STEPS for word in ("--only", step)]
    return run("characterise", folder, *steps, "--jobs", 2)


def judged(damage: Damage, sound: Path, others: Others) -> dict[str, Any]:
    """What came of a damage: the step at which it was told, what was told, whether that is right."""
    folder = sound.parent / "muscle"
    shutil.rmtree(folder)
    shutil.copytree(sound, folder)
    damage.change(folder, others)
    code, said = evaluated(folder)
    lines = said.splitlines()
    match = re.search(damage.says, " ".join(lines))
    before = " ".join(lines)[: match.start()] if match else " ".join(lines)
    steps = re.findall(rf"\b({'|'.join(STEPS)})(?:: as before| \.\.\.)", before)
    step = steps[-1] if steps else ""
    told = [line for line in lines if not re.fullmatch(r"\w+(: as before| \.\.\.)", line)]
    right = bool(match) and step == damage.step and (code == 2 if damage.stops else code == 0)
    return {
        "damage": damage.name,
        "code": code,
        "step": step,
        "told": " ".join(told),
        "right": right,
    }


def main() -> int:
    """Judge every damage; exit code 1 where one is not told as it must be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--only", default="")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    rows = []
    with tempfile.TemporaryDirectory() as place:
        sound, others = prepared(Path(place), given.seed)
        for damage in DAMAGES:
            if given.only not in damage.name:
                continue
            row = judged(damage, sound, others)
            rows.append(row)
            mark = "right" if row["right"] else "WRONG"
            step = row["step"] or "before any step"
            print(f"{mark}  {damage.name}: {step}, exit {row['code']}\n       {row['told']}",
                  flush=True)  # fmt: skip
    wrong = sum(not row["right"] for row in rows)
    print(f"{len(rows)} damages, {wrong} not told as they must be")
    if given.json:
        given.json.write_text(json.dumps({"damages": rows, "wrong": wrong}, indent=1) + "\n")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
