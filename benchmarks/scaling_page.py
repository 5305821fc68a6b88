"""Cost against size, and how near it is to what the machine can do: the figures of "Large work".

    python benchmarks/scaling_page.py [--programmes 1e6] [--pictures 1000]

Writes `docs/figures/scaling.svg` and `docs/figures/scaling.txt`, which the page includes. What was measured
and what is extrapolated from it is said there. On a machine that does nothing else it takes about
ten minutes.
"""

import argparse
import dataclasses
import os
import platform
import sys
import tempfile
import time
from datetime import date
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of the peak

import numpy as np

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
SIZES = 10.0 ** np.arange(7)
LARGEST_PICTURES = 1e4
_REPEATS = 5


@dataclasses.dataclass(frozen=True)
class Curve:
    """Seconds over size.

    Attributes:
        name: what was done, and by how many processes.
        size, seconds: measured, in a process that has compiled, shape (k,).
        largest: to which the last rate is extrapolated.
        peer: whether it is somebody else's.
    """

    name: str
    size: np.ndarray
    seconds: np.ndarray
    largest: float
    peer: bool = False

    @property
    def rate(self) -> float:
        """Per second, at the largest size."""
        return float(self.size[-1] / self.seconds[-1])


def sweeps(programmes: int) -> list[Curve]:
    """Bootstrap programmes of the reference sweep by one process and by two."""
    import scaling  # noqa: PLC0415

    replicates, curves = -(-programmes // scaling.PER_REPLICATE), []
    for jobs, name in ((1, "bootstrap programmes, one process"), (2, "two processes")):
        times = np.array(scaling.started(replicates, jobs)["times_s"])
        times = times[len(times) // 4 :]  # all processes have begun
        size = scaling.PER_REPLICATE * scaling.CHUNK * np.arange(1, len(times))
        some = np.unique(np.minimum(np.searchsorted(size, SIZES), len(size) - 1))
        curves.append(Curve(name, size[some], times[1:][some] - times[0], SIZES[-1]))
    return curves


def clarabel() -> Curve:
    """The same kind of programme by Clarabel, called directly, one after the other."""
    import identification  # noqa: PLC0415
    import jax  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    _, theirs = identification.bootstrap(10, 1, 1000, 3)
    return Curve("Clarabel, one by one", np.array([1000]), np.array([theirs.seconds]), 1e6, True)


def pictures(count: int) -> list[Curve]:
    """Crops of 2650 x 1100 px by one and by two processes, and by scikit-image's four calls."""
    import imaging_speed as speed  # noqa: PLC0415

    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    from rendering import published_scene, render  # noqa: PLC0415
    from skimage.color import rgb2hsv  # noqa: PLC0415

    from imaging import process  # noqa: PLC0415

    photo, curves = render(published_scene(0.175), 7), []
    recipe = speed.recipe_of(speed.truth_of(photo))
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{k:05d}.jpg" for k in range(count)]
        data = photo.jpeg()
        for path in paths:
            path.write_bytes(data)
        for jobs in (1, 2):
            told: list[tuple[float, int]] = []
            process(
                paths, recipe, executor=jobs,
                progress=lambda done, _, told=told: told.append((time.perf_counter(), done)),
            )  # fmt: skip
            # Without the start of the processes.
            at, done = np.array([each for each in told if each[1] >= 2 * jobs]).T
            size, seconds = done[1:] - done[0], at[1:] - at[0]
            some = np.unique(np.minimum(np.searchsorted(size, SIZES), len(size) - 1))
            name = "photographs, one process" if jobs == 1 else "two processes"
            curves.append(Curve(name, size[some], seconds[some], LARGEST_PICTURES))
    start = time.perf_counter()
    for _ in range(_REPEATS):
        speed.by_scikit_image(rgb2hsv(photo.rgb)[..., 2])
    spent = np.array([time.perf_counter() - start])
    peer = Curve("scikit-image's outline", np.array([_REPEATS]), spent, LARGEST_PICTURES, True)
    return [*curves, peer]


def peaks() -> tuple[float, float]:
    """What one thread reaches: flop/s of a matrix product in float64, bytes/s of a copy."""
    A = np.random.default_rng(0).normal(size=(1200, 1200))
    source = np.zeros(2**25)
    target = np.ones_like(source)
    products, copies = [], []
    for _ in range(_REPEATS):
        start = time.perf_counter()
        np.matmul(A, A)
        products.append(time.perf_counter() - start)
        start = time.perf_counter()
        np.copyto(target, source)
        copies.append(time.perf_counter() - start)
    return 2 * len(A) ** 3 / min(products), 2 * source.nbytes / min(copies)


def work_of_a_programme() -> tuple[float, float]:
    """Flops and bytes of a programme of the sweep in the mean: by count, loops by their steps.

    Counted are Gram matrices, Hessians, triangles and the walk through the active sets, from the
    rows that are active in the fit to all readings; bytes are those that must come from memory once:
    weights of the readings, and the coefficients that are summed.
    """
    import jax  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    import scaling  # noqa: PLC0415

    from fitting.sweeps.design import Design  # noqa: PLC0415
    from fitting.sweeps.forms import Forms  # noqa: PLC0415
    from fitting.sweeps.linear_model import LinearModel  # noqa: PLC0415
    from fitting.sweeps.readings import arrange  # noqa: PLC0415
    from fitting.sweeps.replicates import Chunk  # noqa: PLC0415

    data, geometry, deadband = scaling.reference()
    readings = arrange(data, data.specimen.rest_length, 4)
    model = LinearModel(geometry, deadband, 4, readings.pressure, readings.path_end)
    chunk = Chunk.of(Design.of(model, readings), Forms((1, 2, 3, 4)))
    pressures, k = chunk.there.shape
    rows = chunk.A.shape[-1] + 1
    fits = (
        len(chunk.programmes[0].known.ravel()) + len(chunk.programmes[1].known.ravel()) / pressures
    )
    flops = 2.0 * pressures * k * rows**2  # Gram matrices, which all fits of a replicate share
    moved = 8.0 * pressures * k
    for programmes in chunk.programmes:
        *axes, paths, _, n = programmes.W.shape
        m = programmes.G.shape[-2]
        active = float(programmes.rows[1].sum()) / np.prod(axes)
        hessian = 2 * paths * rows**2 * (n**2 + n)
        triangles = 2 * n**3 / 3 + 2 * n**2
        walk = active * (2 * n**2 + 8 * n**2) + 2 * m * n + 2 * n**2  # enter, and look for others
        face = 3 * (4 * active * n + 4 * n**2)  # refined on the active rows
        flops += np.prod(axes) * (hessian + triangles + walk + face)
        moved += 8.0 * np.prod(axes) * paths * (rows - 1)
    return flops / fits, moved / fits


def text_of(fits: list[Curve], shots: list[Curve]) -> str:
    """The tables of the page."""
    lines = [
        f"Measured on {date.today().isoformat()}: {os.cpu_count()} cores ({platform.machine()}), Python "
        f"{platform.python_version()}, load {os.getloadavg()[0]:.1f} at the end. No GPU was there.",
        "",
        "| what | per second | measured up to | takes there | extrapolated |",
        "|---|---|---|---|---|",
    ]
    for one in (*fits, *shots):
        beyond = f"{one.largest:g} in {said(one.largest / one.rate)}"
        beyond = beyond if one.largest > 1.001 * one.size[-1] else "nothing"
        lines.append(
            f"| {one.name} | {one.rate:.3g} | {one.size[-1]:g} | {said(one.seconds[-1])} | {beyond} |"
        )
    (flops, moved), (peak, bandwidth) = work_of_a_programme(), peaks()
    rate = fits[0].rate
    shot = 2650 * 1100 * 3.0
    lines += [
        "",
        f"Two processes do {fits[1].rate / rate:.2f} times the programmes of one, and "
        f"{shots[1].rate / shots[0].rate:.2f} times the photographs.",
        "",
        f"One thread of this machine reaches {peak / 1e9:.3g} Gflop/s in a product of large matrices and "
        f"copies {bandwidth / 1e9:.3g} GB/s. A programme takes {flops:.3g} flop and {moved:.3g} bytes from "
        f"memory, so that the limits are {peak / flops:.3g} programmes a second by arithmetic and "
        f"{bandwidth / moved:.3g} by memory; one process is at {100 * rate * flops / peak:.2g} % of the "
        "first. What keeps it from there: matrices of one to eight rows, whose triangles and walks are "
        "chains of short steps, square roots and divisions. A crop has "
        f"{shot / 1e6:.3g} MB of pixels; the code passes over them as if it read them "
        f"{bandwidth / (shot * shots[0].rate):.3g} times.",
        "",
    ]  # fmt: skip
    return "\n".join(lines)


def said(seconds: float) -> str:
    """A time as a person says it."""
    for size, unit in ((3600.0, "h"), (60.0, "min"), (1.0, "s")):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{1e3 * seconds:.3g} ms"


def draw(fits: list[Curve], shots: list[Curve], path: Path) -> None:
    """Seconds over size: points are measured, dotted lines are not."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(8.5, 3.6), layout="constrained")
    for axes, curves, what in zip(
        figure.subplots(1, 2), (fits, shots), ("programmes", "photographs"), strict=True
    ):
        for number, one in enumerate(curves):
            colour = "0.5" if one.peer else f"C{number}"
            axes.loglog(one.size, one.seconds, "o-", color=colour, label=one.name, markersize=4)
            beyond = np.array([one.size[-1], one.largest])
            axes.loglog(beyond, beyond / one.rate, ":", color=colour)
        axes.set(xlabel=what, ylabel="seconds")
        axes.grid(which="major", alpha=0.3)
        axes.legend(fontsize="small", frameon=False)
    figure.savefig(path, metadata={"Date": None})


def main(arguments: list[str] | None = None) -> int:
    """Measure and write both files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--programmes", type=float, default=1e6)
    parser.add_argument("--pictures", type=int, default=1000)
    given = parser.parse_args(arguments)
    fits = [*sweeps(int(given.programmes)), clarabel()]
    shots = pictures(given.pictures)
    text = text_of(fits, shots)
    print(text)
    (FIGURES / "scaling.txt").write_text(text, encoding="utf-8")
    draw(fits, shots, FIGURES / "scaling.svg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
