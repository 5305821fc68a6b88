/* The device without its hardware: portable C99 with integer arithmetic only, no registers and no clock.
 *
 * A port calls famrig_step once per 2 ms tick with the counts of its converter, sets its output and
 * its pins immediately, then calls famrig_serve and famrig_release. README.md describes the protocol;
 * rig/device.py is the same program in Python and must send the same bytes. */
#ifndef FAMRIG_CORE_H
#define FAMRIG_CORE_H

#include <stdbool.h>
#include <stdint.h>

#ifndef FR_RING
#define FR_RING 64 /* records that can be repeated, 1 to 1024; 14 bytes each */
#endif
#ifndef FR_BYTES_PER_TICK
#define FR_BYTES_PER_TICK 21 /* bytes sent in 2 ms; the line carries 23 at 115200 baud */
#endif
#ifndef FR_TRIP_CEILING
#define FR_TRIP_CEILING 900 /* counts, 4.4 V; no host can set a higher pressure limit */
#endif
#if FR_TRIP_CEILING < 1 || FR_TRIP_CEILING > 1020
#error "FR_TRIP_CEILING is 1 to 1020 counts: a limit at the converter's end is never seen"
#endif

#define FR_PROTOCOL 3
#define FR_FIRMWARE 3
#define FR_TICK_HZ 500
#define FR_LINE_LIMIT 63
#define FR_RECEIVE_SIZE 128 /* a power of two; one byte remains free */
#define FR_SEND_LIMIT 200   /* bytes waiting for their tick */
#if FR_BYTES_PER_TICK <= 28
#define FR_SEND_SIZE 256 /* these, and the bytes released by two ticks */
typedef uint8_t fr_index;
#elif FR_BYTES_PER_TICK <= 156
#define FR_SEND_SIZE 512
typedef uint16_t fr_index;
#else
#define FR_SEND_SIZE 1024
typedef uint16_t fr_index;
#endif
#define FR_JUMP_TICKS 5

enum fr_state { FR_SAFE, FR_RUN, FR_MANUAL, FR_TRIP };
enum fr_fault {
    FR_NO_FAULT, FR_SILENCE, FR_OVER_PRESSURE, FR_JUMP, FR_STALL, FR_WATCHDOG, FR_RANGE, FR_FROZEN,
    FR_NO_RESPONSE
};
/* Whether the reading has varied at rest, as the reading of a noisy transducer does. */
enum fr_alive { FR_NOT_KNOWN, FR_QUIET, FR_ALIVE };
enum fr_cause { FR_POWER_ON = 1, FR_RESET_PIN = 2, FR_BROWN_OUT = 4, FR_WATCHDOG_RESET = 8 };

/* Parameters of the controller; units as in rig/protocol.py. */
typedef struct {
    int32_t set_point;             /* 1/128 psi */
    uint16_t feed_forward;         /* 1/256 PWM count */
    uint16_t proportional;         /* 1/256 PWM count / psi */
    uint16_t integral;             /* 1/256 PWM count / (psi s) */
    int16_t low, high;             /* PWM counts */
    uint16_t zero;                 /* 1/16 count */
    uint16_t span;                 /* 1/64 psi per 1024 counts */
} fr_law;

/* Events to which the pressure must respond. */
enum fr_asked { FR_NOTHING, FR_A_STEP, FR_A_START };

/* Band of the latest readings. */
typedef struct {
    uint16_t low, high;
} fr_band;

/* State that survives a reset: the latched trip and the board number. A port stores it in non-volatile
 * memory. */
typedef struct {
    uint8_t fault;                 /* fault that led to FR_TRIP; with any other value nothing is latched */
    uint8_t output;                /* PWM counts before the trip */
    uint16_t count;                /* reading that caused the trip */
    uint16_t board;                /* 1 to 65534; 0, or 65535 in a blank memory, if there is none */
} fr_latch;

typedef struct {
    int32_t integral;              /* 1/32768 PWM count */
    uint16_t tick;                 /* low half */
    uint16_t pressure_sum, pressure_count, force_sum;
    uint8_t output, flags;
} fr_record;

typedef struct {
    /* control */
    uint32_t tick, seq, since;
    fr_law law, next_law;
    int32_t integral;
    uint16_t trip, jump, stall, silent;
    uint16_t floor, ceiling, still, frozen_ticks;
    uint8_t frozen;
    uint16_t count, pressure_sum, force_sum;
    uint16_t history[FR_JUMP_TICKS];
    uint16_t silence, stall_ticks, stall_from, sync_left, next_sync;
    uint8_t state, next_state, fault, output;
    uint8_t div, next_div, phase, oldest;
    uint8_t over, jumped, outside, manual, next_manual;
    bool sync, changed, fresh;
    /* plausibility of the reading */
    fr_band close, wide;
    int32_t held, settled, answer_held; /* integral terms that held the pressure, 1/32768 PWM count */
    int32_t headroom;              /* from the set point to the limit, 1/128 psi */
    uint16_t still_ticks, close_ticks, quick_ticks, push, wound_push, answer_push, answer_sum;
    uint16_t watch_ticks, watch_from, moves;
    uint8_t alive, liveliness, asked;
    bool leapt;
    fr_latch latch;
    uint32_t tripped_at;
    /* lines that are due */
    bool tell_hello, tell_state, tell_settings;
    bool strict, told_limits;
    /* lines */
    uint16_t boot, bad, good, overrun, dropped, late;
    uint16_t last_id, last_check;
    uint32_t last_seq, base, mask_low, mask_high;
    uint8_t last_reason, cause, line_length;
    char line[FR_LINE_LIMIT + 1];
    uint16_t check, kept;
    volatile uint8_t received_head, received_mark, received_tail;
    fr_index sending_head, sending_start;
    volatile fr_index sent, released;
    uint8_t received[FR_RECEIVE_SIZE];
    uint8_t sending[FR_SEND_SIZE];
    fr_record ring[FR_RING];
} famrig;

/* Starts with the output off, in TRIP if a trip is latched. `boot` is the stored counter; on return,
 * d->boot is the new counter, to be stored. A port also stores d->latch whenever it has changed. */
void famrig_reset(famrig *d, uint8_t cause, uint16_t boot, fr_latch latch);

/* Receives a byte. May interrupt everything except itself and famrig_mark. */
void famrig_receive(famrig *d, uint8_t byte);

/* Begins a tick; bytes that arrive from now on belong to the next tick. */
void famrig_mark(famrig *d);

/* Counts ticks that passed without a step. */
void famrig_late(famrig *d, uint8_t ticks);

/* Runs the guards and the controller. Sets output, state and sync. */
void famrig_step(famrig *d, uint16_t pressure, uint16_t force);

/* Reads at most one line, and writes at most one line and a record. */
void famrig_serve(famrig *d);

/* Releases the bytes of this tick, fewer if the line lags behind. famrig_next must not interrupt. */
void famrig_release(famrig *d);

/* Returns the next byte to send, or -1. */
int16_t famrig_next(famrig *d);

static inline bool famrig_dump_open(const famrig *d)
{
    return d->state != FR_RUN && d->state != FR_MANUAL;
}

#endif
