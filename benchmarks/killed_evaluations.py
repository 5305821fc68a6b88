"""Whether an evaluation that is killed and run again ends with the same bytes.

    python benchmarks/killed_evaluations.py [--seed 3] [--kills 10] [--jobs 2] [--json FILE]

A small twin is evaluated without disturbance. Then its results are removed but for `first-run.json`,
which holds the date of the first run, and `famjax characterise` is killed (SIGKILL, with its workers)
after random times, each run going on from the one before; where one comes to its end, its files are
compared and the next begins anew. After the last kill it runs to its end. All files in `results` are
compared byte by byte.
"""

import argparse
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from rendering.folder import write_twin

RESULTS, FIRST_RUN = "results", "first-run.json"


def command(folder: Path, jobs: int) -> list[str]:
    """The evaluation of a folder."""
    return [sys.executable, "-m", "famjax", "characterise", str(folder), "--jobs", str(jobs)]


def run(words: list[str]) -> None:
    """A command to its end."""
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def emptied(folder: Path) -> None:
    """Remove the results of a folder but for the date of its first run."""
    date = (folder / RESULTS / FIRST_RUN).read_bytes()
    shutil.rmtree(folder / RESULTS)
    (folder / RESULTS).mkdir()
    (folder / RESULTS / FIRST_RUN).write_bytes(date)


def compared(sound: dict[str, str], folder: Path) -> list[str]:
    """Names of the files that differ."""
    again = digests(folder / RESULTS)
    return sorted(
        name for name in sound.keys() | again.keys() if sound.get(name) != again.get(name)
    )


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file of a folder by its path in it."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def killed(folder: Path, jobs: int, seconds: float) -> str:
    """Run the evaluation for some seconds and kill it; the step that was under way, "-" for none."""
    process = subprocess.Popen(
        command(folder, jobs), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    time.sleep(seconds)
    ended = process.poll() is not None
    if not ended:
        os.killpg(process.pid, signal.SIGKILL)
    _, said = process.communicate()
    begun = re.findall(r"^([\w-]+) \.\.\.", said, re.MULTILINE)
    return "ended" if ended else (begun[-1] if begun else "-")


def main() -> int:
    """Kill and compare; exit code 1 where bytes differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "muscle"
        jax.config.update("jax_enable_x64", True)
        write_twin(folder, seed=given.seed)
        begin = time.monotonic()
        run(command(folder, given.jobs))
        whole = time.monotonic() - begin
        sound = digests(folder / RESULTS)
        emptied(folder)
        hit: list[str] = []
        differing: list[str] = []
        while len(hit) < given.kills:
            seconds = float(rng.uniform(0.02, 0.7)) * whole
            step = killed(folder, given.jobs, seconds)
            if step == "ended":
                differing += compared(sound, folder)
                emptied(folder)
            else:
                hit.append(step)
                print(f"killed after {seconds:.1f} s, in step {step}", flush=True)
        run(command(folder, given.jobs))
        differing = sorted({*differing, *compared(sound, folder)})
    for name in differing:
        print("differs:", name)
    print(
        f"{given.kills} kills in {whole:.0f} s of work, {len(sound)} files, {len(differing)} differ"
    )
    if given.json:
        content = {"kills": hit, "files": len(sound), "differing": differing}
        given.json.write_text(json.dumps(content, indent=1) + "\n")
    return int(bool(differing))


if __name__ == "__main__":
    sys.exit(main())
