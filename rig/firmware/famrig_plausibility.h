/* Plausibility of the readings. */
#ifndef FAMRIG_PLAUSIBILITY_H
#define FAMRIG_PLAUSIBILITY_H

#include "famrig_core.h"

#define FR_LIVELY_MOVES 24    /* so often, and `still` is enough; with fewer it takes longer */

/* From here on the pressure has to answer. */
void fr_expect_answer(famrig *d, uint8_t to);

/* One reading at rest. */
void fr_watch(famrig *d, uint16_t pressure);

/* One reading under an output: has one that is alive not varied for too long? */
bool fr_stands_still(famrig *d, uint16_t pressure);

/* One tick in RUN, error in 1/128 psi: has the output pushed too much for a reading that rests? */
bool fr_is_frozen(famrig *d, uint16_t pressure, int32_t error);

/* The same after a start or a step, for a reading whose mean rests. */
bool fr_no_answer(famrig *d, int32_t error);

#endif
