/* The core as a library for tests/rig/native.py, with one call per tick. */
#include "famrig_core.h"

#include <stddef.h>

size_t famrig_host_size(void) { return sizeof(famrig); }

/* Ring and bytes per tick with which this library was built. */
int famrig_host_ring(void) { return FR_RING; }
int famrig_host_trip_ceiling(void) { return FR_TRIP_CEILING; }
int famrig_host_bytes_per_tick(void) { return FR_BYTES_PER_TICK; }

void famrig_host_feed(famrig *d, const uint8_t *bytes, size_t number)
{
    while (number-- > 0)
        famrig_receive(d, *bytes++);
}

void famrig_host_reset(famrig *d, uint8_t cause, uint16_t boot, const uint8_t *latch)
{
    fr_latch kept = {latch[0], latch[1], latch[2] | latch[3] << 8, latch[4] | latch[5] << 8};
    famrig_reset(d, cause, boot, kept);
}

/* Returns output, state, sync, boot counter, and latch: fault, output, count, board. */
void famrig_host_look(const famrig *d, int *values)
{
    values[0] = d->output;
    values[1] = d->state;
    values[2] = d->sync;
    values[3] = d->boot;
    values[4] = d->latch.fault;
    values[5] = d->latch.output;
    values[6] = d->latch.count;
    values[7] = d->latch.board;
}

/* Runs a tick, writes the bytes sent, at most FR_BYTES_PER_TICK, and returns their number. */
size_t famrig_host_tick(famrig *d, uint16_t pressure, uint16_t force, uint8_t *sent, int *values)
{
    size_t number = 0;
    famrig_mark(d);
    famrig_step(d, pressure, force);
    famrig_serve(d);
    famrig_release(d);
    for (int16_t byte = famrig_next(d); byte >= 0; byte = famrig_next(d))
        sent[number++] = (uint8_t)byte;
    famrig_host_look(d, values);
    return number;
}
