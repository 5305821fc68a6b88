"""Notes on the figures: how tables were interpreted, why some figures differ, and what is not computed."""

NOTES: tuple[tuple[str, str], ...] = (
    (
        "2.1",
        "These figures are computed for an ideal braid with the printed diameter and angle, without "
        "bladder or end-fittings. The diameter in a muscle's name is assumed to be that of its braid.",
    ),
    (
        "2.4",
        "These figures are computed with equations 2.6 and 2.7, for a tube with an outer diameter of "
        "0.973 in after swaging.",
    ),
    (
        "2.4, support",
        'The reference work states that the support "approximately doubles" Euler\'s load. With the '
        "printed lengths, a rigid support would multiply the load by 2.81. A support that only stiffens "
        "the tube, pinned at both ends, would multiply it by 1.14. The stiffness that doubles the load is "
        "in units of the bare tube's load divided by its length.",
    ),
    (
        "4, angle",
        "The two printed angles imply slopes of 11.2 and 10.4 lbf/psi, which are inconsistent with each "
        "other. The tested blocked force rises by 11.0 lbf/psi, and by 10.4 to 11.3 lbf/psi between "
        "neighbouring pressures. The forces used in chapter 4 are not printed.",
    ),
    (
        "4.2",
        "The profiles are SYNTHETIC: cylinders with elliptic ends are used instead of photographs. "
        "Only the decrease in the error with the number of terms can be compared.",
    ),
    (
        "4.3",
        "Misprints: as printed, only the row at 0 % describes a muscle, and even in that row, w does "
        "not make the profile symmetric. The corrected w, and the corrected b1 at 35 %, make every "
        "row symmetric. The computation uses the w that makes the profile with the printed a_n and "
        "b_n symmetric about x = 1/2. At 35 % this w is 2.1776 instead of the transcribed 2.176, and "
        "the profile is symmetric within the rounding of the printed numbers. No diameters were "
        "printed for comparison. At 35 % and x = 0, the diameter is the sum of the a_n, which is 1.00 "
        "in to within 0.02 in for any w and b_n. It cannot match the diameter of the end-fittings, "
        "0.863 in.",
    ),
    (
        "5, thread",
        "The readings from which the reference work determined the moduli are not printed. Here the moduli "
        "are computed from the rounded diameters in table 5.1 and the tested blocked forces. The work does "
        "not state which points it used for high pressure.",
    ),
    (
        "5.1",
        "Figures 'from the printed D' use only the triangle relation. Figures 'from the model' use the "
        "thread length at 0 psi, B0 = 9.894 in.",
    ),
    (
        "5.2",
        "The table is interpreted as the state of the braid at the resting length, as a function of "
        "pressure, with and without stretch. Each change is the elastic minus the inelastic value, under "
        "Gaylord's force, at the resting length and at the tested free contraction for each pressure. No "
        "printed figures are available.",
    ),
    (
        "6.1",
        "A contraction of 35.3 % is 0.3 % beyond the last profile. The arc computed with three "
        "Fourier terms is shorter than that of the real outline, which is narrower at its ends.",
    ),
    (
        "6, thickness",
        "Here the threads of the elastic braid are stretched by Gaylord's force. The muscle's own force, "
        "which is zero at free contraction, would stretch them by an eighth less. The reference work does "
        "not state which force it used, so the tolerance of that row covers both.",
    ),
    (
        "6.3",
        "The reference work lists three geometries at 100 psi. The rows for other pressures and "
        "states, and for the measured geometry, are additional. For this term, the measured geometry "
        "is equivalent to the average diameter.",
    ),
    *(
        (
            table,
            f"{subject}. The printed numbers in this table are not available. Mean absolute "
            "differences are relative to the measured geometry, and averaged over contraction.",
        )
        for table, subject in (
            ("6.4", "Axial stress in the bladder"),
            ("6.5", "Axial force in the bladder"),
            ("6.6", "Hoop stress in the bladder"),
            ("6.7", "Hoop force in the bladder"),
            ("6.8", "Force in the bladder, axial and hoop"),
            ("6.9", "Actuation force"),
        )
    ),
    (
        "6, summary",
        "The thread length lost to curvature is the difference between two cylinders, and an artefact "
        "of assuming a cylinder. A thread with constant pitch along the measured outline would be "
        "longer than the real thread, not shorter, so the pitch is not constant. A thread pinned at "
        "its crossings would be 9.96 to 10.08 in long; the measured length is 9.89 in. A thread along "
        "a geodesic would be 9.95 to 9.62 in long, and could not exist at contractions of 26 % or "
        "more. Therefore the crossings do not slide (see equilibrium_shape.py).",
    ),
    (
        "6.11",
        "The printed model columns are not available. The tested column is available, and the rows "
        "list the differences from it. The latex law by itself, without a fit, is not expected to "
        "match the test.",
    ),
    (
        "6.12",
        "The note on table 6.11 also applies here. Each geometry has zero force at a different "
        "contraction. Beyond 35 %, the measured shape is extrapolated by a contraction of up to 1.2 %.",
    ),
    (
        "7.4",
        "The figures are mean errors in blocked force and free contraction over ten pressures, "
        "computed with the printed laws, relative to the tested values. The tested values are printed "
        "for 20 to 100 psi in steps of 20 psi. Those at 10 psi are computed from the errors in table "
        "7.6, which are printed in lbf and in percent. The values at the other four pressures are "
        "interpolated.",
    ),
    (
        "7.6",
        "Misprint: the total MAE does not agree with the mean of its column, which is 2.5. The MAE at "
        "100 psi is printed as 2.58 beside an RMSE of 7.36; it is probably about 5.5.",
    ),
    (
        "virtual work",
        "The five profiles are 8.75 % contraction apart. At a single contraction, especially at either "
        "end, the derivative is that of the spline and depends on the rounding of the coefficients. "
        "The mean from 0 to 35 % at constant pressure is a difference between two volumes and does not "
        "depend on the spline. For the measured shape, this mean is about 15 % below that of Gaylord's "
        "force, and the blocked force is farther from the test. The triangle relation and the photographed "
        "volumes do not agree better than that.",
    ),
)
"""Pairs of a table and a note on it."""

NOT_COMPUTED: tuple[tuple[str, str], ...] = (
    (
        "2.1, tested",
        "forces, contractions and weights of the muscles that were built: these were measured; the table "
        "lists the values for the braid by itself",
    ),
    ("2.4, buckling", "the buckling loads: the modulus of the swage tube is not printed"),
    (
        "2.5",
        "lengths, weights, blocked forces and burst tests of three muscles: these were measured",
    ),
    (
        "3.2 to 3.5",
        "pressure control and comparison of the fluids: these require the recorded pressures and forces",
    ),
    (
        "4.1",
        "accuracy of photogrammetry: this requires the photographs and the machine's displacement",
    ),
    ("4.2, photographs", "errors with 1 to 5 Fourier terms: these require the measured profiles"),
    (
        "4, free contraction",
        "free contraction of the 9-9/32, 12 and 20 in muscles: this was measured",
    ),
    (
        "5, tensile test",
        "modulus (16.9e6 psi) and breaking load of a thread: these require the record of its tensile test",
    ),
    ("6, latex law", "E_n and their errors: these require the stress-strain record of the latex"),
    (
        "6.10",
        "curves without printed numbers: their errors require the tested force curves. The computed curves "
        "for the geometries are plotted in the figure of the total force",
    ),
    ("6.11, tested", "blocked force of the muscle: this was measured, and is an input here"),
    ("6.12, tested", "free contraction of the muscle: this was measured, and is an input here"),
    (
        "7.1 to 7.6, fits",
        "errors of the fits: these require the tested force curves, which are not printed. Fits to a "
        "SYNTHETIC reconstruction are at the end of the page, without verdicts",
    ),
)
"""Pairs of a table and the reason why figures in it are not computed."""
