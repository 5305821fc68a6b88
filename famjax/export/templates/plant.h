/*
@HEADING@
 *
 * The muscle with its circuit; the fluid is @FLUID@, and the pressure is a state. SI units and gauge
 * pressure; requires libm. Air works in single or double precision, water only in double precision.
 */
#ifndef @NAME@_PLANT_H
#define @NAME@_PLANT_H

#include <stddef.h>
#include "@name@.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Pressure [Pa], opening of the valve or pump, opening of the dump valve; active length [m] and state of
 * the friction at the end of the last step. */
typedef struct {
    @name@_real pressure, opening, dump, length, memory[@MEMORY@];
} @name@_state;

extern const size_t @name@_state_size;

/* Volume [m3] of the fluid in the muscle. */
@name@_real @name@_volume(@name@_real length, @name@_real pressure);

/* Start at rest, with the valves and the pump also at rest. */
void @name@_start(@name@_state *at, @name@_real length, @name@_real pressure);

/* Time derivatives of pressure [Pa/s], opening [1/s] and dump [1/s], for an ODE solver. The signal of the
 * valve or pump is a fraction of the full output, 0 to 1; dump is 1 if the dump valve is open, else 0. */
void @name@_rates(const @name@_state *at, @name@_real signal, @name@_real dump, @name@_real length,
                  @name@_real velocity, @name@_real rates[3]);

/* Force [N], including friction and viscous loss, after a motion to this length without reversal. */
@name@_real @name@_pull(const @name@_state *at, @name@_real length, @name@_real velocity);

/* Complete a solver step: update the state of the friction to this length and the current pressure. */
void @name@_moved(@name@_state *at, @name@_real length);

/* Advance by dt [s], for example 2 ms, from this length at constant signal, dump and velocity [m/s], with
 * a two-stage, second-order, L-stable implicit method. Fluid is conserved. */
void @name@_step(@name@_state *at, @name@_real signal, @name@_real dump, @name@_real length,
                 @name@_real velocity, @name@_real dt);

#ifdef __cplusplus
}
#endif

#endif
