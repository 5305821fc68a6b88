"""What stands beside the figures: how tables were read, why some differ, what cannot be computed."""

NOTES: tuple[tuple[str, str], ...] = (
    (
        "2.1",
        "The ideal braid of the printed diameter and angle: no bladder, no end-fittings. The "
        "diameter in a muscle's name is taken for its braid's.",
    ),
    (
        "2.4",
        "Equations 2.6 and 2.7, with 0.973 in for the tube after the die.",
    ),
    (
        "2.4, support",
        'The print says that the support "approximately doubles" Euler\'s load. By its lengths a rigid '
        "one would multiply it by 2.81, and one that only stiffens the tube between pins by 1.14; the "
        "stiffness that doubles it is in units of the bare tube's load over its length.",
    ),
    (
        "4, angle",
        "The two printed angles imply slopes of 11.2 and 10.4 lbf/psi, which contradict one another, and "
        "the tested blocked forces rise by 11.0 lbf/psi, between neighbouring pressures by 10.4 to 11.3. "
        "The forces that chapter 4 used are not printed.",
    ),
    (
        "4.2",
        "SYNTHETIC: elliptic ends and a cylinder instead of photographs. Only the fall of the "
        "error with the number of terms can be compared.",
    ),
    (
        "4.3",
        "Misprints: as printed only the row at 0 % describes a muscle, and even its w is not that of a "
        "symmetric profile; the corrected w, and b1 at 35 %, make "
        "every row symmetric. Used is the w that the printed a_n and b_n themselves make symmetric "
        "about x = 1/2: at 35 % it is 2.1776 in place of the transcribed 2.176, and the profile is "
        "symmetric to the rounding of the print. No diameters were printed to hold these against. "
        "At x = 0 the sum of the a_n is 1.00 in at 35 %, to 0.02 in whatever w and b_n are: the "
        "0.863 in of the end-fittings cannot be laid on this row.",
    ),
    (
        "5, thread",
        "The readings behind the moduli are not printed. Here they follow from table 5.1's rounded "
        "diameters and the tested blocked forces; which points count as high pressure is not said.",
    ),
    (
        "5.1",
        "'From the printed D' uses the triangle alone. 'Of the model' starts from B0 = 9.894 in, the "
        "length at 0 psi.",
    ),
    (
        "5.2",
        "Read as the braid over pressure at rest, with and without stretch. Changes: elastic minus "
        "inelastic, under Gaylord's own force, at the resting length and at the tested free "
        "contraction of each pressure; no figures of them were given to us.",
    ),
    (
        "6.1",
        "35.3 % lies 0.3 % beyond the last profile. The arc of three Fourier terms is shorter than the "
        "outline, which is narrower at its ends.",
    ),
    (
        "6, thickness",
        "Out of tolerance: the elastic braid's, by 0.00002 in. Its threads are stretched by Gaylord's "
        "force here; by the muscle's own, which is zero when it is free, they would be stretched an "
        "eighth less, and the wall be 0.0336 to 0.0337 in thick.",
    ),
    (
        "6.3",
        "The print gives three geometries at 100 psi; the other pressures, states and the measured "
        "geometry (equal to the average diameter in this term) are ours.",
    ),
    *(
        (
            table,
            f"{subject}. The numbers of this table were not given to us. Mean absolute differences "
            "are over contraction, from the measured geometry.",
        )
        for table, subject in (
            ("6.4", "Axial stress of the bladder"),
            ("6.5", "Axial force of the bladder"),
            ("6.6", "Hoop stress of the bladder"),
            ("6.7", "Hoop force of the bladder"),
            ("6.8", "Force of the bladder, axial and hoop"),
            ("6.9", "Actuation force"),
        )
    ),
    (
        "6, summary",
        "The thread length lost to curvature is that of two cylinders. It is an artefact of the cylinder: "
        "wound on the measured outline at constant pitch the thread would be longer than it is, not "
        "shorter, so that its pitch is not constant. Pinned where threads cross, it would be 9.96 to "
        "10.08 in long, beside 9.89 measured; as a geodesic 9.95 to 9.62, and impossible from 26 % on: "
        "the crossings hold (equilibrium_shape.py).",
    ),
    (
        "6.11",
        "The model columns were not given to us; the tested column was, and the difference from "
        "it is listed. The latex law alone, not fitted, is not expected to meet the test.",
    ),
    (
        "6.12",
        "As 6.11. Each geometry's own zero-force point; beyond 35 % the measured shape is "
        "extrapolated by up to 1.2 % of contraction.",
    ),
    (
        "7.4",
        "Blocked force and free contraction of the printed laws against the tested ones, at the five "
        "pressures of which those are printed. Out of tolerance: the free contraction of the optimised "
        "law, by 0.0001. The work's mean is over ten pressures, of which five are not printed.",
    ),
    (
        "7.6",
        "Misprint: the total MAE. The mean of its column is 2.5, and the MAE of 100 psi, 2.58 beside an "
        "RMSE of 7.36, is probably about 5.5.",
    ),
    (
        "virtual work",
        "Five profiles 8.75 % of contraction apart: at one contraction, above all at either end, "
        "the rate is the spline's and moves with the rounding of the coefficients. The mean from "
        "0 to 35 % is, at constant pressure, a difference of two volumes and free of the spline: "
        "measured, it is about 15 % below Gaylord's, and the blocked force moves away from the "
        "test. The triangle relation and the photographed volumes do not agree to better than that.",
    ),
)
"""(table, remark) for readers."""

NOT_COMPUTED: tuple[tuple[str, str], ...] = (
    (
        "2.1, tested",
        "forces, contractions and weights of built muscles: measured; what the braid alone would "
        "do stands in the table",
    ),
    ("2.4, buckling", "the loads themselves: the swage tube's modulus is not printed"),
    ("2.5", "lengths, weights, blocked forces, bursts of three muscles: measured"),
    ("3.2 to 3.5", "pressure control and fluid comparison: need the recorded pressures and forces"),
    ("4.1", "accuracy of photogrammetry: needs the photographs and the machine's displacement"),
    ("4.2, photographs", "errors of 1 to 5 Fourier terms: need the measured profiles"),
    ("4, free contraction", "of the 9-9/32, 12 and 20 in muscles: measured"),
    ("5, tensile test", "thread modulus 16.9e6 psi and break: need the thread's test record"),
    ("6, latex law", "E_n with their errors: need the latex's stress-strain record"),
    (
        "6.10",
        "curves without printed numbers; errors along them need the tested force curves. The "
        "geometries' own curves are drawn in the figure of the total force",
    ),
    ("6.11, tested", "blocked force of the muscle itself: measured, an input here"),
    ("6.12, tested", "free contraction of the muscle itself: measured, an input here"),
    (
        "7.1 to 7.6, fits",
        "their errors: need the tested force curves, which are not printed. Fits of a "
        "SYNTHETIC reconstruction stand at the end of the page, without verdicts",
    ),
)
"""(figures, why they are not computed)."""
