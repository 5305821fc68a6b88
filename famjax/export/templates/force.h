/*
@HEADING@
 *
 * SI units throughout: m, Pa (gauge), N. Static map in C99, without state, allocation or libm.
 * Compile with -D@NAME@_REAL=float for single precision. Beyond the data, the muscle becomes slack or
 * reaches a stop. The force is finite, non-negative and monotone everywhere.
 */
#ifndef @NAME@_H
#define @NAME@_H

#ifndef @NAME@_REAL
#define @NAME@_REAL double
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef @NAME@_REAL @name@_real;

/* Region [m], [Pa] in which the model is used unchanged; highest pressure that the inverse returns. */
#define @NAME@_SHORTEST @SHORTEST@
#define @NAME@_LONGEST @LONGEST@
#define @NAME@_LOWEST_PRESSURE @LOWEST@
#define @NAME@_HIGHEST_PRESSURE @HIGHEST@
#define @NAME@_PRESSURE_LIMIT @LIMIT@

/* Force F [N], >= 0, at an active length [m] and a gauge pressure [Pa]. */
@name@_real @name@_force(@name@_real length, @name@_real pressure);

/* Model force [N], not clipped: it is negative where the muscle is slack and F is 0. */
@name@_real @name@_model_force(@name@_real length, @name@_real pressure);

/* Axial stiffness dF/dL [N/m] at constant pressure. */
@name@_real @name@_stiffness(@name@_real length, @name@_real pressure);

/* Lowest gauge pressure [Pa] at which the muscle exerts a force [N]: 0 if the force at zero pressure is
 * larger, the pressure limit if the force is never reached. For a force <= 0, the highest pressure at
 * which the muscle is slack. Takes at most 60 steps. */
@name@_real @name@_pressure(@name@_real length, @name@_real force);

#ifdef __cplusplus
}
#endif

#endif
