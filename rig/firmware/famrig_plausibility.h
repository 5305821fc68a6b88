/* Plausibility of the readings. */
#ifndef FAMRIG_PLAUSIBILITY_H
#define FAMRIG_PLAUSIBILITY_H

#include "famrig_core.h"

#define FR_LIVELY_MOVES 24    /* number from which `still` applies unchanged; with fewer, the time is longer */

/* Requires the pressure to respond from now on. */
void fr_expect_answer(famrig *d, uint8_t to);

/* Observes a reading at rest. */
void fr_watch(famrig *d, uint16_t pressure);

/* Processes a reading while driven; returns true if a varying reading has been constant for too long. */
bool fr_stands_still(famrig *d, uint16_t pressure);

/* Processes a tick in RUN, error in 1/128 psi; returns true if the push is too large for a constant reading. */
bool fr_is_frozen(famrig *d, uint16_t pressure, int32_t error);

/* The same, after a start or a step, if the mean reading does not respond. */
bool fr_no_answer(famrig *d, int32_t error);

#endif
