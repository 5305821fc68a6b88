/*
@HEADING@
 *
 * The muscle with its circuit, @FLUID@; the pressure is a state. SI units, gauge pressure; needs libm.
 * Air works in single or double precision, water only in double precision.
 */
#ifndef @NAME@_PLANT_H
#define @NAME@_PLANT_H

#include <stddef.h>
#include "@name@.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Pressure [Pa], opening of valve or pump, opening of the dump valve; active length [m] and friction at
 * the end of the last step. */
typedef struct {
    @name@_real pressure, opening, dump, length, memory[@MEMORY@];
} @name@_state;

extern const size_t @name@_state_size;

/* Volume [m3] of the fluid in the muscle. */
@name@_real @name@_volume(@name@_real length, @name@_real pressure);

/* Start at rest, with valves and pump at rest too. */
void @name@_start(@name@_state *at, @name@_real length, @name@_real pressure);

/* d/dt of pressure [Pa/s], opening [1/s] and dump [1/s] for a solver of differential equations. The valve
 * or pump signal is 0 to 1 of the full output; dump is 1 if the dump valve is open, else 0. */
void @name@_rates(const @name@_state *at, @name@_real signal, @name@_real dump, @name@_real length,
                  @name@_real velocity, @name@_real rates[3]);

/* Force [N], with friction and viscous loss, after a motion to a length without reversal. */
@name@_real @name@_pull(const @name@_state *at, @name@_real length, @name@_real velocity);

/* End a solver step: the friction state is updated to this length and the pressure. */
void @name@_moved(@name@_state *at, @name@_real length);

/* Advance by dt [s], 2 ms for example, from this length at constant signal, dump and velocity [m/s], by
 * a two-stage, second-order, L-stable implicit rule. Fluid is conserved. */
void @name@_step(@name@_state *at, @name@_real signal, @name@_real dump, @name@_real length,
                 @name@_real velocity, @name@_real dt);

#ifdef __cplusplus
}
#endif

#endif
