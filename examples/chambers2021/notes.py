"""Notes on the figures: how tables were interpreted, why some differ, and what cannot be computed."""

NOTES: tuple[tuple[str, str], ...] = (
    (
        "2.1",
        "Computed for the ideal braid with the printed diameter and angle: no bladder, no "
        "end-fittings. The diameter in a muscle's name is assumed to be that of its braid.",
    ),
    (
        "2.4",
        "Computed with equations 2.6 and 2.7, and 0.973 in for the tube after the die.",
    ),
    (
        "2.4, support",
        'The print says that the support "approximately doubles" Euler\'s load. With the printed lengths, '
        "a rigid support would multiply it by 2.81, and a support that only stiffens the tube between pins "
        "by 1.14. The stiffness that doubles it is in units of the bare tube's load divided by its length.",
    ),
    (
        "4, angle",
        "The two printed angles imply slopes of 11.2 and 10.4 lbf/psi, which are inconsistent. The tested "
        "blocked forces rise by 11.0 lbf/psi, and by 10.4 to 11.3 between neighbouring pressures. The "
        "forces used in chapter 4 are not printed.",
    ),
    (
        "4.2",
        "SYNTHETIC: elliptic ends and a cylinder instead of photographs. Only the decrease in the "
        "error with the number of terms can be compared.",
    ),
    (
        "4.3",
        "Misprints: as printed, only the row at 0 % describes a muscle, and even there w is not that "
        "of a symmetric profile. The corrected w, and b1 at 35 %, make every row symmetric. The "
        "computation uses the w that makes the printed a_n and b_n symmetric about x = 1/2: at 35 % it "
        "is 2.1776 instead of the transcribed 2.176, and the profile is symmetric within the rounding "
        "of the print. No diameters were printed for comparison. At x = 0 the sum of the a_n is 1.00 "
        "in at 35 %, to within 0.02 in for any w and b_n. It cannot match the 0.863 in of the "
        "end-fittings.",
    ),
    (
        "5, thread",
        "The readings from which the work found the moduli are not printed. Here the moduli follow "
        "from the rounded diameters in table 5.1 and the tested blocked forces. The work does not "
        "state which points count as high pressure.",
    ),
    (
        "5.1",
        "'From the printed D' uses only the triangle. 'From the model' starts from B0 = 9.894 in, the "
        "length at 0 psi.",
    ),
    (
        "5.2",
        "Interpreted as the braid at rest as a function of pressure, with and without stretch. A change is "
        "elastic minus inelastic, under Gaylord's own force, at the resting length and at the tested free "
        "contraction at each pressure. No printed figures are available.",
    ),
    (
        "6.1",
        "35.3 % is 0.3 % beyond the last profile. The arc with three Fourier terms is shorter than the "
        "outline, which is narrower at its ends.",
    ),
    (
        "6, thickness",
        "Here Gaylord's force stretches the threads of the elastic braid. The muscle's own force, which is "
        "zero at free contraction, would stretch them by an eighth less. The work does not say which it "
        "used, so the tolerance of that row covers both.",
    ),
    (
        "6.3",
        "The print lists three geometries at 100 psi. The other pressures and states, and the measured "
        "geometry (for this term the same as the average diameter), are additional.",
    ),
    *(
        (
            table,
            f"{subject}. The numbers in this table are not available. Mean absolute differences are "
            "taken over contraction, relative to the measured geometry.",
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
        "of the cylinder. On the measured outline at constant pitch, the thread would be longer than "
        "it is, not shorter, so its pitch is not constant. If pinned at its crossings, it would be "
        "9.96 to 10.08 in long; 9.89 in was measured. As a geodesic it would be 9.95 to 9.62 in long, "
        "and could not exist from 26 % contraction on. So the crossings do not slide "
        "(equilibrium_shape.py).",
    ),
    (
        "6.11",
        "The model columns are not available. The tested column is available, and the rows list the "
        "difference from it. The latex law by itself, without a fit, is not expected to match the test.",
    ),
    (
        "6.12",
        "As in 6.11. Each geometry has its own point of zero force. Beyond 35 %, the measured shape is "
        "extrapolated by a contraction of up to 1.2 %.",
    ),
    (
        "7.4",
        "Mean errors over ten pressures in blocked force and free contraction, computed with the "
        "printed laws, relative to the tested values. The tested ends are printed for 20 to 100 psi in "
        "steps of 20 psi. Those at 10 psi follow from the errors in lbf and percent in table 7.6. The "
        "other four are interpolated.",
    ),
    (
        "7.6",
        "Misprint: the total MAE. The mean of its column is 2.5. The MAE at 100 psi, printed as 2.58 "
        "with an RMSE of 7.36, is probably about 5.5.",
    ),
    (
        "virtual work",
        "The five profiles are 8.75 % contraction apart. At a single contraction, especially at either "
        "end, the derivative is that of the spline and depends on the rounding of the coefficients. "
        "The mean from 0 to 35 % at constant pressure is a difference between two volumes and does not "
        "depend on the spline. For the measured shape it is about 15 % below Gaylord's, and the "
        "blocked force moves away from the test. The triangle relation and the photographed volumes "
        "agree no better than that.",
    ),
)
"""Pairs of table and note for the reader."""

NOT_COMPUTED: tuple[tuple[str, str], ...] = (
    (
        "2.1, tested",
        "forces, contractions and weights of the muscles that were built: measured; the table lists the "
        "values for the braid alone",
    ),
    ("2.4, buckling", "the loads themselves: the swage tube's modulus is not printed"),
    ("2.5", "lengths, weights, blocked forces and burst tests of three muscles: measured"),
    (
        "3.2 to 3.5",
        "pressure control, fluid comparison: these require the recorded pressures and forces",
    ),
    (
        "4.1",
        "accuracy of photogrammetry: this requires the photographs and the machine's displacement",
    ),
    ("4.2, photographs", "errors with 1 to 5 Fourier terms: these require the measured profiles"),
    ("4, free contraction", "free contraction of the 9-9/32, 12 and 20 in muscles: measured"),
    (
        "5, tensile test",
        "thread modulus, 16.9e6 psi, and break: these require the thread's test record",
    ),
    ("6, latex law", "E_n with their errors: these require the latex's stress-strain record"),
    (
        "6.10",
        "curves without printed numbers; errors along them require the tested force curves. The "
        "geometries' own curves are drawn in the figure of the total force",
    ),
    ("6.11, tested", "blocked force of the muscle itself: measured, an input here"),
    ("6.12, tested", "free contraction of the muscle itself: measured, an input here"),
    (
        "7.1 to 7.6, fits",
        "errors of the fits: these require the tested force curves, which are not printed. Fits to a "
        "SYNTHETIC reconstruction are at the end of the page, without verdicts",
    ),
)
"""Pairs of figures and the reason why they are not computed."""
