"""Chapter 3, the rig: pressure control while a machine strokes the muscle, on the simulated rig."""

# %% [markdown]
# # Chapter 3: the rig
# A microcontroller controls the pressure in the muscle while a testing machine strokes the muscle. It
# uses two valves for air and a pump for water. A PI controller converts the error in psi to PWM counts.
# Its gains were tuned by hand for each muscle and fluid. The journal and the machine have separate
# clocks, which must be aligned before any comparison.
#
# The records of pressure and force are not printed. Here the twin is tested on the simulated rig with the
# printed gains, supply pressure and valve bias. Noise, friction and flow capacities are assumed if they
# are not printed. Each figure for the twin is compared with the measured one.

# %%

import numpy as np
from beside_print import Chapter, Row, printed
from twin import Twin

from famjax import units
from famjax.app import analyse, simulate
from fitting.records import Characterisation, Isobar, read_machine_log
from rig.control import Control
from rig.journal import read_journal
from rig.plan import Isobaric, PlanFile

chapter = Chapter(__name__)
FAM = "7/8 in"


# %% [markdown]
# ## Table 3.2: the gains, and a test with water
# The twin's folder contains a test with air. Here the same strokes are run with water and with the printed
# gains Kp and Ki.


# %%
def gains(fluid: str) -> Control:
    """Return the gains printed in table 3.2 for the 7/8 in muscle."""
    (of,) = [row[fluid] for row in printed()["controller_gains"] if row["fam"] == FAM]
    return Control.per_psi(of["Kp"], of["Ki"])


def water(twin: Twin) -> Characterisation:
    """Test the twin with water at the same set pressures as with air, and keep the result in its folder."""
    folder, test = twin.folder / "water", twin.test
    rest = twin.sheet.specimen.rest_length
    if not (folder / "machine.csv").exists():
        bars, true = test.characterisation.isobars, twin.muscle
        # Limited to the known shape: the machine reverses at zero force, or after this stroke.
        stroke = min(rest - float(test.record.length.min()), 0.34 * rest)
        set_pressures = tuple(bar.set_pressure for bar in bars)
        rate = printed()["specimen"]["stroke_rate_in_per_s"] * units.INCH
        plan = Isobaric(set_pressures, 1, stroke, rate, settle=6.0)
        supply = printed()["pressure_control"]["supply_psi"] * units.PSI
        water = PlanFile(plan, "water", supply, gains("water"))
        simulate(water, folder, muscle=true.muscle(), friction=true.friction)
    journal, log = read_journal(folder / "test.fam"), read_machine_log(folder / "machine.csv")
    return analyse(journal, log, rest_length=rest).characterisation


# %% [markdown]
# ## Tables 3.3 and 3.4: mean and scatter of the pressure
# The test with water runs at 0.04 in/s, as in chapter 4, which is twice the rate of the printed tables.
# The pump lags behind each reversal of the stroke, so the pressure scatters more than in the work. (At
# 0.1 in/s, the rate of the twin's test with air, the pump is too slow and the device trips.)


# %%
def held(tests: dict[str, Characterisation]) -> list[Row]:
    """Return the mean and standard deviation of the pressure during the strokes, by set pressure."""
    (of,) = [row for row in printed()["pressure_result"] if row["fam"] == FAM]
    found = []
    for (table, name, key), (fluid, test) in (
        (what, one)
        for what in (("3.3", "mean pressure", "mean"), ("3.4", "scatter of the pressure", "std"))
        for one in tests.items()
    ):
        theirs = dict(
            zip(printed()["pressure_control"]["set_psi"], of[f"{key}_{fluid}_psi"], strict=True)
        )
        for bar in test.isobars:
            P = round(bar.set_pressure / units.PSI)
            ours = (bar.pressure if key == "mean" else bar.pressure_std) / units.PSI
            found.append(Row(table, f"TWIN, {fluid}, {P} psi, {name}", ours, "psi", theirs.get(P)))
    return found


# %% [markdown]
# ## Table 3.5: does the fluid change the force?
# In the reference work, the fluid changes the force by at most 7.65 lbf in 1058 lbf. The two tests of the
# twin also differ in stroke rate.


# %%
def force_rmse(one: Isobar, other: Isobar) -> float:
    """Return the RMS difference [N] in force over both branches, at common lengths (equation 3.8)."""
    low, high = (of(one.length[k], other.length[k]) for k, of in ((-1, max), (0, min)))
    at = np.linspace(low, high, 100)
    ours, theirs = (
        [np.interp(at, bar.length[::-1], of[::-1]) for of in (bar.shortening, bar.lengthening)]
        for bar in (one, other)
    )
    return float(np.sqrt(np.mean(np.square(np.subtract(ours, theirs)))))


def fluids(tests: dict[str, Characterisation]) -> list[Row]:
    """Return the RMS difference in force between air and water, at each pressure."""
    theirs = dict(
        zip(
            printed()["pressure_control"]["set_psi"],
            printed()["fluid_rmse"]["fam_7_8"],
            strict=True,
        )
    )
    found = []
    air, water = tests.values()
    others = {bar.set_pressure: bar for bar in water.isobars}
    for bar in air.isobars:
        if bar.set_pressure not in others:
            continue
        P = round(bar.set_pressure / units.PSI)
        difference = force_rmse(bar, others[bar.set_pressure])
        entry = f"TWIN, {P} psi, difference in force between air and water"
        found.append(Row("3.5", entry, difference / units.LBF, "lbf", theirs.get(P)))
    return found


# %% [markdown]
# ## The clocks
# The lead of the machine's clock over the journal's is computed from the two force records. For the twin,
# the true lead is known.


# %%
def clocks(twin: Twin) -> list[Row]:
    """Compare the computed alignment of the clocks with the true one."""
    found, true = twin.test.alignment, twin.truth.rig
    at = (found.reference - true.clock_ahead) / (1 + true.clock_drift)
    error = float(found.journal_time(found.reference)) - at
    return [
        Row("3, clocks", "TWIN, error in the alignment of journal and log", error, "s"),
        Row("3, clocks", "TWIN, stated standard error of the alignment", found.offset_error, "s"),
    ]


# %%
if chapter.shown:
    twin = Twin.of_command_line()
    both = {"air": twin.test.characterisation, "water": water(twin)}
    chapter.show("tables 3.3 and 3.4: pressure during the strokes", held(both))
    chapter.show("table 3.5: air compared with water", fluids(both))
    chapter.show("section 3: clocks", clocks(twin))
