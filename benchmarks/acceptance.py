"""Every acceptance figure as one line: what holds, and what does not.

    python benchmarks/acceptance.py [--only PATTERN ...] [--data [NAME=]PATH ...] [--quick | --long]
                                    [--list] [--json FILE]

A figure is measured anew each time it is printed. `--data` takes other force maps of the same form, CSV
files or folders of them: `--data MAP.csv` measures what is asked of any map (certificates, optimality,
time), and prints errors whose limit belongs to another muscle without a verdict; `--data
DMSP-20-300=MAP.csv` puts a map in the place of one, limits and all; `--data 'a series=FOLDER'` gives the
specimens of a series, `--data 'maps with truth=FOLDER'` maps as in `default_answer.py`.
"""

import argparse
import dataclasses
import fnmatch
import json
import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from first_answer import DATA, WAITS
from row import Case, Cost, Limit, Outcome, Row, files, judge, rows, tell

import fitting

A1, A2 = "DMSP-20-300", "DMSP-10-250"
BOTH = (A1, A2)
LOADED = "loaded readings"
ROUNDING = "the optimum to rounding"
HALF_WIDTH = "a band of 95 % that is neither too narrow nor too wide"
PAPER = "the best of published models and laws on this map"
GUARD = "the rated time of the guard, with one tick"


def _fits() -> Iterator[Row]:
    identify = "fitting.identify(data)"
    for data, physical, free in ((A1, 7.6, 4.6), (A2, 1.9, 1.8)):
        for name, limit in (("cubic", physical), ("cubic, wide bounds", free)):
            yield from rows(
                f"fit, {name}", "fits:model", ("RMSE [N]", "<=", limit, "the global optimum, rounded up"),
                ("converged and Drucker-stable", ">=", 1, "a fit to believe"), of=name, data=data,
                command=identify, part=LOADED, seed=0, cost="quick", of_its_data=True,
            )  # fmt: skip
    for data, name, rmse, pressure, length in (
        (A1, "Ogden, ends, rest length to its rounding", 4.0, 4.2, 11.0),
        (A2, "Ogden, compliant braid, the rubber of the DMSP-20 as a prior", 1.25, 1.55, 7.0),
    ):
        yield from rows(
            f"fit, {name}", "fits:model", ("RMSE [N]", "<=", rmse, PAPER),
            ("parameters", "<=", 7, "no more than the peers have"),
            ("converged and Drucker-stable", ">=", 1, "a fit to believe"), of=name, data=data,
            command=identify, part=LOADED, seed=0, cost="quick", of_its_data=True,
        )  # fmt: skip
        yield from rows(
            f"fit, {name}", "fits:left_out", ("RMSE, one pressure out [N]", "<=", pressure, PAPER),
            ("RMSE, one interior length out [N]", "<=", length, PAPER), of=name, data=data,
            command="fitting.validate(fit, ...)", part=LOADED, seed=0, of_its_data=True,
        )  # fmt: skip
    for data, name, rmse in (
        (A1, "Mooney-Rivlin, wide bounds", 3.3), (A2, "cubic, wide bounds", 1.7),
        (A1, "quartic linear in pressure, wide bounds", 3.0),
        (A2, "cubic linear in pressure, wide bounds", 1.1),
    ):  # fmt: skip
        yield from rows(f"fit, {name}, in sample", "fits:model", ("RMSE [N]", "<=", rmse, PAPER), of=name,
                        data=data, command=identify, part=LOADED, seed=0, cost="quick",
                        of_its_data=True)  # fmt: skip
    yield from rows(
        "certificate", "fits:certificates", ("KKT residual, relative", "<=", 1e-9, ROUNDING),
        ("duality gap, relative", "<=", 1e-9, ROUNDING),
        ("gradient residual of the geometry", "<=", 1e-6, "the root of the rounding of the cost"),
        ("stability margin / largest coefficient", ">=", -1e-9, ROUNDING), data=BOTH, command=identify,
        part=LOADED, seed=0, cost="quick",
    )  # fmt: skip
    yield from rows(
        "sweep of 48 fits", "fits:sweep",
        ("determined fits not certified", "<=", 0, "each is a convex programme"),
        ("undetermined fits not refused", "<=", 0, "nothing is made up"),
        ("largest relative duality gap", "<=", 1e-9, ROUNDING),
        ("largest violation between stations / largest coefficient", "<=", 1e-9, ROUNDING), data=BOTH,
        command="fitting.sweep(data, geometry)", part=LOADED, seed=0,
    )  # fmt: skip
    synthetic: dict = {"data": "made-up muscles", "command": identify}
    recovered: Limit = (
        "largest relative error of a parameter",
        "<=",
        1e-6,
        "readings without noise",
    )
    yield from rows("truth found again, polynomial", "fits:recovery", recovered, of="polynomial", seed=0,
                    cost="quick", **synthetic)  # fmt: skip
    yield from rows("truth found again, Ogden on a rig that gives", "fits:recovery", recovered, of="ogden",
                    seed=1, **synthetic)  # fmt: skip
    chance = "what one run in a thousand gives by chance"
    yield from rows(
        "intervals", "fits:coverage",
        ("least probability of the hits of 68% intervals", ">=", 1e-3, chance),
        ("least probability of the hits of 95% intervals", ">=", 1e-3, chance), seed=11, cost="long",
        part="200 replicates", **synthetic,
    )  # fmt: skip
    yield from rows(
        "posterior", "posterior:sampled", ("largest R-hat", "<=", 1.01, "Vehtari et al. 2021"),
        ("smallest effective size, bulk and tails", ">=", 400, "Vehtari et al. 2021"),
        ("CPU time after compilation [s]", "<=", 20, "a person waits for it"), data=A1,
        command="fitting.sample(fitting.identify(data))", part=LOADED, seed=0,
    )  # fmt: skip
    for censored in (False, True):
        yield from rows(
            f"posterior, ranks of truths{', censored' * censored}", "posterior:calibration",
            ("smallest p of uniform ranks x parameters", ">=", 0.05, "a test at 5 % over all parameters"),
            of=censored, data="200 truths from the prior", command="fitting.sample(fit)",
            part="slack and saturated readings too" if censored else LOADED, seed=0, cost="long",
        )  # fmt: skip


def _default_answer() -> Iterator[Row]:
    dense: dict[str, tuple[str, tuple[Limit, ...]]] = {
        "own": ("60 muscles of a physics written apart, in ordinary laboratories", (
            ("silently wrong", "<=", 0, "no error without a word"),
            ("mean RMSE [%]", "<=", 0.5, "the noise of these maps"),
            ("mean half-band [%]", "<=", 2.2, "a band that still says something"))),
        "hard": ("24 such muscles that fit the map of the DMSP-10-250", (
            ("bad", "<=", 1, "one in 24 by chance, of bands of 95 %"),
            ("mean coverage [%]", ">=", 95, "what the band says"))),
        "bundled": ("both bundled maps thinned and with noise; the truth is the fit of the whole", (
            ("silently wrong", "<=", 0, "no error without a word"),
            ("worst error [half-bands]", "<=", 2, "short of what counts as wrong"))),
        "given": ("maps with truth", (("silently wrong", "<=", 0, "no error without a word"),)),
    }  # fmt: skip
    for group, (about, limits) in dense.items():
        yield from rows(f"default answer, {group}", "default_answer:dense", *limits, of=group, data=about,
                        command="famjax fit MAP.csv && famjax predict", cost="long", seed=0,
                        part="states inside the measured range")  # fmt: skip
    fit = "famjax fit MAP.csv"
    yield from rows(
        "slack muscle", "default_answer:slack",
        ("slack readings without 0 N in their band", "<=", 0, "a slack muscle pulls nothing"),
        ("force at rest without pressure [N]", "<=", 0, "a slack muscle pulls nothing"),
        ("forces far beyond the braid's limits", "<=", 0, "no muscle can be there"), data=BOTH,
        command="famjax predict FIT.json", seed=0,
    )  # fmt: skip
    yield from rows(
        "place of the choice among all models", "default_answer:place",
        ("place by RMSE, 1 for the first", "<=", 1, "else another were the default"), data=BOTH,
        command="famjax compare MAP.csv", part="interior lengths, while each was left out", seed=0,
        cost="long",
    )  # fmt: skip
    for data, rmse, pressure, length in ((A1, 4.0, 4.2, 11.0), (A2, 1.25, 1.55, 8.0)):
        of: dict = {"data": data, "part": LOADED, "seed": 0}
        yield from rows("choice", "default_answer:chosen", ("RMSE [N]", "<=", rmse, PAPER), command=fit,
                        of_its_data=True, **of)  # fmt: skip
        yield from rows("choice, one pressure out", "default_answer:nested_pressures",
                        ("RMSE [N]", "<=", pressure, PAPER), command=f"{fit} --validate", cost="long",
                        of_its_data=True, **of)  # fmt: skip
        yield from rows(
            "choice, one length out", "default_answer:nested_lengths",
            ("RMSE on interior lengths [N]", "<=", length, PAPER), command=f"{fit} --validate",
            of_its_data=True, **of,
        )  # fmt: skip
        yield from rows(
            "choice, one length out", "default_answer:nested_lengths",
            ("part of the readings inside the 95 % band", ">=", 0.8, "95 %, of few lengths"),
            command=f"{fit} --validate", **of,
        )  # fmt: skip
    yield from rows(
        "choice with the shape from mechanics", "default_answer:with_shape",
        ("held-out error / that of the bare choice", "<=", 1.02, "one more model does no harm"), data=BOTH,
        command=f"{fit} --ends equilibrium", part=LOADED, seed=0, cost="long",
    )  # fmt: skip
    inside, width = (
        "part of the readings inside the 95 % band",
        "mean full width of the band / RMSE",
    )
    yield from rows(
        "choice, lengths of both muscles", "default_answer:both_muscles",
        (inside, ">=", 0.88, HALF_WIDTH), (inside, "<=", 0.99, HALF_WIDTH), (width, "<=", 8, HALF_WIDTH),
        data="both bundled maps", command=f"{fit} --validate", part="every length, left out", seed=0,
    )  # fmt: skip
    for name in ("bpa10 10cm", "bpa10 30cm"):
        yield from rows("choice on raw ramps", "default_answer:chosen",
                        ("RMSE [N]", "<=", 2.3, "the scatter of repeated ramps"), data=name, part=LOADED,
                        command="famjax ramps ... && famjax fit famjax-ramps/map.csv", seed=0,
                        of_its_data=True)  # fmt: skip
    yield from rows(
        "a series", "default_answer:series_out",
        ("RMSE [N]", "<=", 20.5, "the spread of specimens of one make"), (inside, ">=", 0.85, HALF_WIDTH),
        ("least part of a specimen's readings inside", ">=", 0.7, HALF_WIDTH), (width, "<=", 4, HALF_WIDTH),
        data="a series", command="famjax series MAPS", part="each specimen, left out", seed=0,
    )  # fmt: skip
    yield from rows(
        "verdict", "wrong_files:verdicts",
        ("wrong files that end 0", "<=", 0, "a wrong file is no muscle"),
        ("wrong files whose cause is named, part", ">=", 0.9, "some mistakes look alike"),
        ("sound maps that end 1", "<=", 0, "nobody is turned away"),
        ("sound maps with a false cause", "<=", 1, "one in twenty"),
        data="bundled maps and random muscles", command="famjax fit MAP.csv",
        part="20 sound maps, 36 mistakes", seed=0, cost="long",
    )  # fmt: skip


def _speed() -> Iterator[Row]:
    yield from rows(
        "speed, 10 000 programmes", "speed:batch",
        ("times faster than Clarabel, called directly", ">=", 50, "what makes a bootstrap of sweeps cheap"),
        ("times faster than SLSQP, exact gradients", ">=", 150, "a convex core in place of a local solver"),
        ("largest relative difference of the objective from Clarabel's", "<=", 1e-6, "its own accuracy"),
        data="SYNTHETIC reconstruction", command="jax.vmap(fitting.convex.solve_qp)", part="one pressure",
        seed=0,
    )  # fmt: skip
    yield from rows(
        "speed, joint identification", "speed:joint",
        ("times faster than lmfit, 16 starts", ">=", 5, "variable projection and exact derivatives"),
        ("RMSE / the best of lmfit", "<=", 1.0001, "as good an optimum"), data=BOTH,
        command='fitting.identify(data, constraint="none")', part="compiled",
    )  # fmt: skip
    waits = "a person waits: a few times an import"
    for name, wait in WAITS.items():
        limits: list[Limit] = [(f"{regime}, CPU time / import", "<=", limit, waits)
                  for regime in ("cold", "second")
                  if not math.isnan(limit := getattr(wait, regime))]  # fmt: skip
        cost: Cost = "long" if wait.long else "minutes"
        yield from rows(f"first answer, {name}", "first_answer:command_wait", *limits, of=name, data=DATA,
                        command=name, part="process and its children", cost=cost)  # fmt: skip


def _photographs() -> Iterator[Row]:
    scenes: dict = {"data": "rendered scenes", "command": "famjax measure"}
    half = "a third of a pixel of the published camera"
    yield from rows(
        "photographs", "photographs:accuracy", ("diameter, bias [in]", "<=", 0.0008, "a fifth of a pixel"),
        ("diameter, RMS [in]", "<=", 0.0015, half), ("length [in]", "<=", 0.0015, half),
        ("volume, relative", "<=", 1e-3, "twice the bias of the diameter"),
        ("three-term Fourier RMSE [in]", "<=", 0.0015, half),
        ("harsh light, diameter bias [in]", "<=", 0.002, "half a pixel"),
        ("frontal light, diameter bias [in]", "<=", 0.002, "half a pixel"),
        ("contraction over a stroke, error [in]", "<=", 0.002, "half a pixel"),
        ("scale from the ruler, relative", "<=", 5e-5, "a tenth of the diameter's error"),
        part="2650 x 1100 px", seed=0, **scenes,
    )  # fmt: skip
    inside = "angle at z within its 95 % interval, part"
    yield from rows(
        "photographs, braid angle", "photographs:braid_angles",
        ("angle at z within 0.3 deg, part", ">=", 0.95, "0.3 deg is 1 % of force"),
        ("mean angle of a picture, largest error [deg]", "<=", 0.3, "0.3 deg is 1 % of force"),
        (inside, ">=", 0.88, HALF_WIDTH), (inside, "<=", 0.99, HALF_WIDTH),
        ("strands counted right, part", ">=", 0.95, "a wrong count is a wrong angle"),
        part="60 scenes of 150 to 260 px/in", seed=0, **scenes,
    )  # fmt: skip
    sharp = "no wider than without the tests for deceit"
    yield from rows(
        "photographs that deceive", "photographs:attacks",
        ("silent errors", "<=", 2, "1 % of the scenes"),
        ("sound pictures measured without a warning, part", ">=", 0.85, "a warning is rare"),
        ("sound pictures, median standard error of the length [in]", "<=", 0.000903, sharp),
        ("sound pictures, median standard error of the diameter [in]", "<=", 0.000445, sharp),
        part="200 scenes with faults at random", seed=0, cost="long", **scenes,
    )  # fmt: skip


def _plants() -> Iterator[Row]:
    for fluid in ("air", "water"):
        yield from rows(
            "plant, steps of 2 ms", "plants:steps",
            (f"{fluid}, pressure [psi]", "<=", 0.005, "a fiftieth of the transducer's noise"),
            (f"{fluid}, force [lbf]", "<=", 0.02, "a twentieth of the load cell's noise"),
            command="famjax.plant.simulate", data="simulated plant", part="fills, strokes, a dump",
        )  # fmt: skip
    yield from rows(
        "tuned gains", "plants:tuned",
        ("air, pressure RMS [psi]", "<=", 0.25, "the noise of the transducer"),
        ("water, pressure RMS [psi]", "<=", 0.35, "the noise of the transducer, and the pump's lag"),
        ("air, overshoot of 20 psi [%]", "<=", 10, "2 psi of a step"),
        ("water, overshoot of 20 psi [%]", "<=", 10, "2 psi of a step"),
        ("air, highest pressure [psi]", "<=", 115, "the limit: no trip"),
        ("water, highest pressure [psi]", "<=", 115, "the limit: no trip"),
        ("force between fluids [lbf]", "<=", 2, "five times the load cell's noise"),
        command="famjax rig tune", data="simulated rig", part="8 of 16 plants, not tuned for", seed=0,
    )  # fmt: skip
    inside = "part of the 95 % intervals with the truth"
    yield from rows(
        "plant found again", "plants:identified",
        (inside, ">=", 0.92, "95 %, of 400"), (inside, "<=", 0.98, "95 %, of 400"),
        ("root mean square error [%]", "<=", 3, "what a rig repeats"), cost="long", seed=0,
        command="fitting.identify_plant(record, plant)", data="simulated records with noise",
        part="five random plants of each fluid, five records of 12 s",
    )  # fmt: skip
    yield from rows(
        "plant, cost", "plants:costs",
        ("gradient over simulation", "<=", 8, "reverse mode, with what it keeps"),
        ("256 plants over one", "<=", 100, "else a loop would do"),
        command="famjax.plant.simulate", data="simulated plant", part="2 s of plant and controller",
    )  # fmt: skip


def _rig() -> Iterator[Row]:
    rig: dict = {"data": "simulated rig", "cost": "long"}
    yield from rows(
        "rig, firmware", "rigs:firmware", ("Python = C, equal ticks", ">=", 3e6, "byte for byte"),
        ("AVR = C, equal records", ">=", 1e5, "byte for byte"),
        ("over-pressure to output 0 [s]", "<=", 6.5e-3, "three ticks and a conversion"),
        ("silence to output 0, latest [s]", "<=", 1.005, GUARD),
        ("silence to output 0, earliest [s]", ">=", 0.995, GUARD),
        ("hang to output 0 [s]", "<=", 0.27, "the watchdog's 250 ms, with its tolerance"),
        command="famjax rig", part="all phases between two ticks", seed=0, **rig,
    )  # fmt: skip
    yield from rows(
        "rig, transducer that lies", "rigs:faults",
        ("true pressures over the limit + 2 % or the set pressure + 25 psi", "<=", 0, "muscles bear it"),
        ("false trips in sound tests", "<=", 0, "else the guards get switched off"),
        command="famjax rig run", part="1000 faults, 200 sound tests", seed=0, **rig,
    )  # fmt: skip
    yield from rows(
        "rig, link and journal", "rigs:link", ("damaged line, records lost", "<=", 0, "each is repeated"),
        ("damaged line, wrong records", "<=", 0, "each has a checksum"),
        ("recorder killed, largest loss [s]", "<=", 0.02, "two records"),
        ("torn journals, wrong rows", "<=", 0, "each line has a checksum"), command="famjax rig run",
        part="10 million records with 1 % bytes damaged, 50 kills, 1000 tears", seed=1, **rig,
    )  # fmt: skip
    for fluid in ("air", "water"):
        yield from rows(
            "rig, isobars", "rigs:isobars",
            (f"{fluid}, largest error of a mean [psi]", "<=", 0.1, "better than tables 3.3 and 3.4"),
            (f"{fluid}, largest standard deviation [psi]", "<=", 0.45, "tables 3.3 and 3.4"),
            (f"{fluid}, least standard deviation [psi]", ">=", 0.15, "the sensor's noise is in it"),
            command="famjax rig simulate", part="10 to 100 psi, 3 cycles", seed=0, **rig,
        )  # fmt: skip


def _folders() -> Iterator[Row]:
    inside = "95 % intervals of parameters and forces, part with the truth"
    twin: dict = {"cost": "long", "command": "famjax characterise FOLDER"}
    yield from rows(
        "twins", "folders:twins", ("diameter, RMS error [in]", "<=", 0.002, "half a pixel"),
        ("contraction, largest error", "<=", 0.002, "half a pixel"),
        ("stress over the visited strains, largest error / largest", "<=", 0.03, "the scatter of rubber"),
        ("force at pressures held out, RMS error / largest", "<=", 0.005, "the load cell's accuracy"),
        ("force from photographs and true profiles, RMS error / largest", "<=", 0.001, "no part of it"),
        (inside, ">=", 0.88, HALF_WIDTH), (inside, "<=", 0.99, HALF_WIDTH),
        ("evaluation from cold, mean wall time [s]", "<=", 180, "a person waits"), data="small twins",
        part="20 twins", seed=0, **twin,
    )  # fmt: skip
    stated = "errors that are those made"
    for way in ("load", "motion"):
        for what in ("offset", "rate"):
            name = f"by the {way}, {what}, RMS error / standard error"
            yield from rows("clocks", "folders:clocks", (name, ">=", 0.8, stated),
                            (name, "<=", 1.2, stated), data="simulated tests", part="100 seeds", seed=0,
                            **twin)  # fmt: skip


def _print_and_export() -> Iterator[Row]:
    digits = "half a unit of the last digit and what is named beside it"
    chapters: list[Limit] = [
        (f"chapter {n}, figures out of tolerance", "<=", 0, digits) for n in (2, 4, 5, 6, 7)
    ]
    yield from rows(
        "reference work", "reproduce:printed_figures", *chapters,
        ("tables without a row, or with one that is no number", "<=", 0, "all that follow from the print"),
        data="printed figures", command="famjax reproduce", part="figures with a tolerance",
    )  # fmt: skip
    card: dict = {"data": "the bundled card DMSP-20", "cost": "quick"}
    for real, force, pressure in (("double", 1e-6, 1.0), ("float", 1e-4, 200.0)):
        digits = f"digits of a {real}"
        yield from rows(
            f"export, C in {real}", "exported:in_c",
            ("force, largest error in the largest force", "<=", force, digits),
            ("pressure of a force, largest error [Pa]", "<=", pressure, digits),
            ("code without tables, gcc -Os [bytes]", "<=", 3000, "a tenth of an Uno"), of=real,
            command="famjax export dmsp-20 --to c", seed=3,
            part="4000 states, up to twice the data's lengths and pressures", **card,
        )  # fmt: skip
    yield from rows(
        "export, equations", "exported:in_equations",
        ("NumPy, largest error in the largest force", "<=", 1e-9, "the same equations"),
        ("Octave, largest error in the largest force", "<=", 1e-9, "the same equations"),
        ("answers out of range that are no NaN", "<=", 0, "nobody asked there"),
        ("lengths in cm that are no error", "<=", 0, "a unit is mistaken silently"),
        command="famjax export dmsp-20 --to matlab --to python", part="10 000 states", seed=4, **card,
    )  # fmt: skip
    yield from rows(
        "export, MuJoCo", "exported:in_mujoco",
        ("equilibrium, difference from length_at_load [m]", "<=", 1e-6, "far below what a rig reads"),
        ("force without the callback [N]", "<=", 0, "no callback, no muscle"),
        ("knee, driven past either end of the stroke [strokes]", ">=", 0.3, "finite beyond the data"),
        ("knee, largest speed of the last second [rad/s]", "<=", 0.1, "no energy is made"),
        ("step, C over a callback that returns a constant", "<=", 1.5, "the callback is what costs"),
        ("step, Python over a callback that returns a constant", "<=", 4, "no compiler needed"),
        command="famjax export dmsp-20 --to mujoco", part="three loads; 10 s at the default step", **card,
    )  # fmt: skip
    plants = [("C", "c", "c"), ("MuJoCo", "mujoco", "mujoco")]
    plants += [("FMU in co-simulation", "CoSimulation", "fmu")]
    plants += [("FMU in model exchange", "ModelExchange", "fmu")]
    for name, kind, target in plants:
        yield from rows(
            f"export of a plant, {name}", "exported:with_plants",
            ("pressure, largest difference in its range", "<=", 1e-3, "below what a rig reads"),
            ("force, largest difference in its range", "<=", 1e-3, "below what a rig reads"), of=kind,
            command=f"famjax export dmsp-20 --to {target} --plant plan.toml", seed=0,
            part="air and water, 10 s of commands with a moving length", **card,
        )  # fmt: skip
    yield from rows(
        "export, MJX", "exported:in_mjx",
        ("derivative by E_1, relative difference from central ones", "<=", 1e-6, "their own error"),
        data="a cubic law", command="famjax export dmsp-20 --to mjx", part="rollout of 50 steps",
    )  # fmt: skip


def _shapes() -> Iterator[Row]:
    example: dict = {"data": "printed figures", "cost": "quick"}
    script = "python examples/chambers2021/equilibrium_shape.py --json"
    yield from rows(
        "shape from mechanics", "shapes:printed",
        ("mid diameter, largest error [%]", "<=", 2.1, "the rounding of the print"),
        ("D(x), largest RMSE [in]", "<=", 0.11, "the unexplained fatter shoulders"),
        ("free contraction, isotropic law, largest error", "<=", 0.006, "the work errs by 0.021"),
        ("blocked force, largest difference from the prototype [lbf]", "<=", 8, "the wall that thins"),
        command=script, part="nothing fitted to the muscle", **example,
    )  # fmt: skip
    yield from rows(
        "shape from mechanics, one law", "shapes:one_law",
        ("RMSE [lbf]", "<=", 9, "one law for all pressures, where the work needed one for each"),
        command=f"{script} --fit", part="ten printed figures", **example,
    )  # fmt: skip
    yield from rows(
        "shape from mechanics, work", "shapes:work",
        ("left over, part of the fluid's work", "<=", 1e-8, "force and volume have one potential"),
        command="famjax.work_budget", part="five strokes", **example,
    )  # fmt: skip
    yield from rows(
        "shape from mechanics, speed", "shapes:speed",
        ("times faster than solve_bvp", ">=", 50, "what makes a fit of shapes possible"),
        ("largest difference of the force [lbf]", "<=", 1e-3, "the boundary value solver's own error"),
        ("pressures with a gap between states that were found", "<=", 0, "every stable shape is found"),
        ("tracing and compiling, CPU time / import of jax", "<=", 2.5, "a person waits"),
        data="printed figures", command="famjax.EquilibriumMuscle.force", part="540 states",
    )  # fmt: skip


ROWS: tuple[Row, ...] = (
    *_fits(), *_default_answer(), *_speed(), *_photographs(), *_plants(), *_rig(), *_folders(),
    *_print_and_export(), *_shapes(),
)  # fmt: skip
COSTS = {"quick": {"quick"}, "usual": {"quick", "minutes"}, "long": {"quick", "minutes", "long"}}


def chosen(patterns: Sequence[str], cost: str) -> list[Row]:
    """Rows by name and cost.

    Args:
        patterns: as for file names, or part of a name; none for all.
        cost: key of `COSTS`.

    Raises:
        ValueError: a pattern that fits nothing.
    """

    def fits(one: Row, pattern: str) -> bool:
        return pattern in one.title or fnmatch.fnmatch(one.title, f"*{pattern}*")

    for pattern in patterns:
        if not any(fits(one, pattern) for one in ROWS):
            raise ValueError(f"no row fits {pattern!r}; --list prints all of them")
    return [
        one
        for one in ROWS
        if one.cost in COSTS[cost] and (not patterns or any(fits(one, p) for p in patterns))
    ]


def given_data(words: Iterable[str]) -> tuple[dict[str, str], list[str]]:
    """Paths in the place of named data, and maps that stand for themselves.

    Args:
        words: of `--data`, `[NAME=]PATH`.

    Raises:
        ValueError: a path that is not there, or a folder without a CSV file.
    """
    places: dict[str, str] = {}
    others: list[str] = []
    for word in words:
        name, equals, path = word.rpartition("=")
        if not equals and path in fitting.bundled_names():
            others.append(path)
            continue
        if not Path(path).exists():
            raise ValueError(f"--data must be a CSV file or a folder of them; there is no {path}")
        if not files(path):
            raise ValueError(f"the folder {path} has no CSV file")
        if equals:
            places[name] = path
        else:
            others += files(path)
    return places, others


def cases(
    given: Sequence[Row], places: dict[str, str], others: Sequence[str], shared: Case
) -> Iterator[tuple[Row, Case, bool]]:
    """Each row with what it is measured on, and whether its limit is that of these data.

    Args:
        given: chosen rows.
        places: paths in the place of named data.
        others: maps that stand for themselves: rows of maps are measured on each of them, once.
        shared: interpreter, repetitions, and what is known already.
    """
    seen, bundled = set(), fitting.bundled_names()
    for one in given:
        if one.data in places:
            path = places[one.data]
            yield one, dataclasses.replace(shared, name=f"{one.data}={path}", source=path), True
        elif one.data not in bundled:
            yield one, dataclasses.replace(shared, name=one.data), True
        else:
            for source in others or [one.data]:
                if (one.title, one.direction, source) not in seen or not others:
                    seen.add((one.title, one.direction, source))
                    case = dataclasses.replace(shared, name=source, source=source)
                    yield one, case, one.data == source


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line for each row; exit code 1 if one does not hold."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="PATTERN", help="'fit*RMSE', 'rig'"
    )
    parser.add_argument("--data", nargs="+", default=[], metavar="[NAME=]PATH", help="other maps")
    cost = parser.add_mutually_exclusive_group()
    cost.add_argument("--quick", action="store_const", dest="cost", const="quick",
                      help="what takes seconds once the fits are made")  # fmt: skip
    cost.add_argument("--long", action="store_const", dest="cost", const="long",
                      help="also what takes many minutes")  # fmt: skip
    parser.add_argument("--repeat", type=int, default=3, help="of times; the least counts")
    parser.add_argument("--python", default=sys.executable, help="interpreter of timed processes")
    parser.add_argument("--list", action="store_true", help="print the rows and end")
    parser.add_argument("--json", type=Path, help="file for the outcomes")
    given = parser.parse_args(arguments)
    try:
        wanted = chosen(given.only, given.cost or ("long" if given.list else "usual"))
        places, others = given_data(given.data)
    except ValueError as error:
        parser.error(str(error))
    if given.list:
        for one in wanted:
            print(Outcome(one, one.data, math.nan, "not run", one.cost).line())
        return 0
    import jax  # noqa: PLC0415 -- after the number of its threads is set

    jax.config.update("jax_enable_x64", True)
    shared, outcomes = Case(python=given.python, repeat=given.repeat), []
    for one, case, own_data in cases(wanted, places, others, shared):
        tell(f"{one.title}, {case.name} ...")
        outcomes.append(judge(one, case, own_data=own_data))
        print(outcomes[-1].line(), flush=True)
    verdicts = [one.verdict for one in outcomes]
    print(", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in dict.fromkeys(verdicts)))
    if given.json:
        text = json.dumps([one.as_dict() for one in outcomes], indent=1, allow_nan=False)
        given.json.write_text(text, encoding="utf-8")
    return int("does NOT hold" in verdicts)


if __name__ == "__main__":
    sys.exit(main())
