/* Guards, controller, commands and records. famrig_text.c handles text and numbers. */
#include "famrig_core.h"
#include "famrig_plausibility.h"
#include "famrig_text.h"

#include <stddef.h>
#include <string.h>

#define IN_A_ROW 3         /* consecutive conversions beyond a limit that cause a trip */
#define STEP 384           /* 1/128 psi, 3 psi: smaller steps need no response, because strokes hide it */
#define STALL_RISE 5       /* smallest rise in counts */
#define MAX_ERROR 32767    /* largest error in the proportional term, 1/128 psi */
#define ONE_COUNT INT32_C(32768) /* one PWM count, in units of the integral */
#define SAMPLE_ROOM 68     /* bytes reserved for a record; other lines must leave this much free */
#define ANSWER_ROOM (SAMPLE_ROOM + 50)
#define REPEAT_ROOM (2 * SAMPLE_ROOM)
#define REPORT_ROOM (SAMPLE_ROOM + 100)
#define SETTINGS_ROOM (SAMPLE_ROOM + 120)

static uint16_t distance(uint16_t a, uint16_t b) { return a > b ? a - b : b - a; }

static bool is_trip(uint8_t fault)
{
    return fault >= FR_OVER_PRESSURE && fault <= FR_NO_RESPONSE && fault != FR_WATCHDOG;
}

void famrig_reset(famrig *d, uint8_t cause, uint16_t boot, fr_latch latch)
{
    memset(d, 0, sizeof *d);
    d->boot = boot + 1u;
    d->cause = cause;
    d->fault = cause & FR_WATCHDOG_RESET ? FR_WATCHDOG : FR_NO_FAULT;
    d->law.low = -128;
    d->law.high = 128;
    d->law.span = 200 * 64;
    d->next_law = d->law;
    d->div = d->next_div = 5;
    d->jump = 77;
    d->stall = 1500;
    d->silent = 500;
    d->floor = 51;
    d->ceiling = 963;
    d->still = 350;
    d->liveliness = FR_LIVELY_MOVES;
    d->frozen = 4;
    d->frozen_ticks = 375;
    d->latch.board = latch.board == 0xFFFF ? 0 : latch.board;
    if (is_trip(latch.fault)) {
        latch.board = d->latch.board;
        d->latch = latch;
        d->state = FR_TRIP;
        d->fault = latch.fault;
    }
    d->tell_hello = d->tell_state = d->tell_settings = true;
    d->sending[d->sending_head++] = '\n'; /* ends the line that the reset interrupted */
}

/* ---- controller: rig/protocol.py, in 32 bits ---- */

static int32_t pressure_error(const fr_law *law, uint16_t counts, uint8_t ticks)
{
    int32_t steps = 16 * (int32_t)counts - (int32_t)ticks * law->zero;
    int32_t high = steps >> 8; /* floor: steps = 256 high + low */
    int32_t low = steps & 255;
    int32_t measured = (law->span * high + ((law->span * low + 4096) >> 8)) >> 5;
    return ticks * law->set_point - measured;
}

static int32_t next_integral(const fr_law *law, int32_t integral, int32_t error)
{
    uint32_t size = error < 0 ? -(uint32_t)error : (uint32_t)error;
    uint32_t whole = size / FR_TICK_HZ, rest = size % FR_TICK_HZ;
    int32_t change = (int32_t)(law->integral * whole
                               + (law->integral * rest + FR_TICK_HZ / 2) / FR_TICK_HZ);
    integral += error < 0 ? -change : change;
    if (integral < law->low * ONE_COUNT)
        return law->low * ONE_COUNT;
    return integral > law->high * ONE_COUNT ? law->high * ONE_COUNT : integral;
}

static uint8_t drive(const fr_law *law, int32_t integral, int32_t error)
{
    if (error > MAX_ERROR)
        error = MAX_ERROR;
    if (error < -MAX_ERROR)
        error = -MAX_ERROR;
    int32_t sum = law->proportional * error + integral + law->feed_forward * INT32_C(128);
    sum = (sum + ONE_COUNT / 2) >> 15;
    return sum < 0 ? 0 : sum > 255 ? 255 : (uint8_t)sum;
}

/* ---- states and guards ---- */

static void leave(famrig *d, uint8_t state, uint8_t fault, uint16_t pressure)
{
    if (state == FR_TRIP) {
        d->latch.fault = fault;
        d->latch.output = d->output;
        d->latch.count = pressure;
        d->tripped_at = d->tick;
    }
    d->state = state;
    d->fault = fault;
    d->next_state = FR_SAFE;
    d->output = 0;
    d->integral = 0;
    d->watch_ticks = 0;
    d->tell_state = true;
}

static void enter(famrig *d)
{
    d->state = d->next_state;
    d->fault = FR_NO_FAULT;
    d->next_state = FR_SAFE;
    d->manual = d->next_manual;
    d->integral = d->held = d->settled = 0;
    d->over = d->jumped = d->outside = 0;
    d->stall_ticks = d->still_ticks = d->close_ticks = d->push = d->wound_push = 0;
    d->close.low = d->close.high = d->count;
    d->leapt = false;
    d->tell_state = true;
    fr_expect_answer(d, FR_A_START);
}

/* Settings and states set by commands act from the first tick of a record. */
static void begin_record(famrig *d)
{
    d->pressure_sum = d->force_sum = 0;
    if (d->changed) {
        d->changed = false;
        if (d->next_law.set_point >= d->law.set_point + STEP && d->asked == FR_NOTHING)
            fr_expect_answer(d, FR_A_STEP);
        d->law = d->next_law;
        d->div = d->next_div;
        d->since = d->seq;
        d->tell_settings = true;
        d->headroom = -pressure_error(&d->law, d->trip, 1);
    }
    if (d->next_state != FR_SAFE)
        enter(d);
    if (d->next_sync) {
        d->sync_left = d->next_sync;
        d->next_sync = 0;
    }
    d->sync = d->sync_left > 0;
    d->sync_left -= d->sync;
}

static bool out_of_range(const famrig *d, uint16_t pressure)
{
    return pressure < d->floor || pressure > d->ceiling;
}

static void guard(famrig *d, uint16_t pressure)
{
    bool still = fr_stands_still(d, pressure);
    d->outside = out_of_range(d, pressure) ? d->outside + 1 : 0;
    d->over = pressure >= d->trip ? d->over + 1 : 0;
    d->jumped = distance(pressure, d->history[d->oldest]) > d->jump ? d->jumped + 1 : 0;
    d->silence++;
    if (d->over >= IN_A_ROW)
        leave(d, FR_TRIP, FR_OVER_PRESSURE, pressure);
    else if (d->outside >= IN_A_ROW)
        leave(d, FR_TRIP, FR_RANGE, pressure);
    else if (d->jumped >= IN_A_ROW)
        leave(d, FR_TRIP, FR_JUMP, pressure);
    else if (d->silence >= d->silent)
        leave(d, FR_SAFE, FR_SILENCE, pressure);
    else if (still)
        leave(d, FR_TRIP, FR_FROZEN, pressure);
}

/* True if output or integral is at its upper limit for too long without a rise. */
static void check_stall(famrig *d, uint16_t pressure, int32_t error)
{
    bool wound = d->law.high > 0 && d->integral >= d->law.high * ONE_COUNT;
    if (error <= 0 || !(d->output == 255 || wound)) {
        d->stall_ticks = 0;
        return;
    }
    if (d->stall_ticks == 0 || pressure >= d->stall_from + STALL_RISE) {
        d->stall_from = pressure;
        d->stall_ticks = 0;
    }
    if (++d->stall_ticks >= d->stall)
        leave(d, FR_TRIP, FR_STALL, pressure);
}

static void regulate(famrig *d, uint16_t pressure)
{
    int32_t error = pressure_error(&d->law, pressure, 1);
    if (d->phase == d->div)
        d->integral = next_integral(&d->law, d->integral,
                                    pressure_error(&d->law, d->pressure_sum, d->div));
    d->output = drive(&d->law, d->integral, error);
    check_stall(d, pressure, error);
    if (d->state != FR_RUN)
        return;
    if (fr_is_frozen(d, pressure, error))
        leave(d, FR_TRIP, FR_FROZEN, pressure);
    else if (fr_no_answer(d, error))
        leave(d, FR_TRIP, FR_NO_RESPONSE, pressure);
}

static void end_record(famrig *d)
{
    fr_record *record = &d->ring[d->seq % FR_RING];
    record->tick = (uint16_t)d->tick;
    record->pressure_sum = d->pressure_sum;
    record->pressure_count = d->count;
    record->force_sum = d->force_sum;
    record->output = d->output;
    record->integral = d->integral;
    record->flags = d->state + 4 * d->sync + 16 * d->fault;
    d->phase = 0;
    d->seq++;
    d->kept += d->kept < FR_RING;
    d->fresh = true;
}

void famrig_step(famrig *d, uint16_t pressure, uint16_t force)
{
    d->tick++;
    if (d->phase == 0)
        begin_record(d);
    if (famrig_dump_open(d)) {
        fr_watch(d, pressure);
    } else {
        guard(d, pressure);
    }
    d->count = d->history[d->oldest] = pressure;
    d->oldest = d->oldest + 1 == FR_JUMP_TICKS ? 0 : d->oldest + 1;
    d->pressure_sum += pressure;
    d->force_sum += force;
    d->phase++;
    if (d->state == FR_RUN)
        regulate(d, pressure);
    else if (d->state == FR_MANUAL)
        d->output = d->manual;
    if (d->phase == d->div)
        end_record(d);
}

void famrig_late(famrig *d, uint8_t ticks)
{
    d->tick += ticks;
    d->late += ticks;
}

/* ---- commands ---- */

static uint32_t in_force(const famrig *d) { return d->seq + (d->phase > 0); }

static uint8_t change_state(famrig *d, uint8_t verb, const int32_t *values)
{
    switch (verb) {
    case FR_VERB_RUN:
    case FR_VERB_MAN:
        if (d->state == FR_TRIP)
            return FR_TRIPPED;
        if (d->trip == 0)
            return FR_NO_LIMIT;
        if (out_of_range(d, d->count))
            return FR_OUTSIDE;
        d->next_state = verb == FR_VERB_RUN ? FR_RUN : FR_MANUAL;
        d->next_manual = verb == FR_VERB_RUN ? 0 : (uint8_t)values[0];
        if (verb == FR_VERB_RUN && d->state == FR_RUN)
            d->next_state = FR_SAFE; /* already running */
        break;
    case FR_VERB_STOP:
        d->next_state = FR_SAFE;
        if (!famrig_dump_open(d))
            leave(d, FR_SAFE, FR_NO_FAULT, d->count);
        break;
    case FR_VERB_CLEAR:
        if (!famrig_dump_open(d))
            return FR_RUNNING;
        if (d->state == FR_TRIP && d->trip && d->count >= d->trip)
            return FR_PRESSURE;
        if (d->state == FR_TRIP && out_of_range(d, d->count))
            return FR_OUTSIDE;
        d->latch.fault = FR_NO_FAULT;
        leave(d, FR_SAFE, FR_NO_FAULT, d->count);
        break;
    case FR_VERB_SYNC:
        d->next_sync = (uint16_t)values[0];
        break;
    }
    return FR_OK;
}

static uint8_t change_settings(famrig *d, uint8_t verb, const int32_t *values, uint8_t number)
{
    switch (verb) {
    case FR_VERB_SET:
        d->next_law.set_point = values[0];
        if (number > 1)
            d->next_law.feed_forward = (uint16_t)values[1];
        break;
    case FR_VERB_GAIN:
        d->next_law.proportional = (uint16_t)values[0];
        d->next_law.integral = (uint16_t)values[1];
        break;
    case FR_VERB_ILIM:
        d->next_law.low = (int16_t)values[0];
        d->next_law.high = (int16_t)values[1];
        break;
    case FR_VERB_CAL:
        if (!famrig_dump_open(d))
            return FR_RUNNING;
        d->next_law.zero = (uint16_t)values[0];
        d->next_law.span = (uint16_t)values[1];
        break;
    case FR_VERB_TELE:
        if (values[0] * FR_BYTES_PER_TICK < SAMPLE_ROOM)
            return FR_BAUD;
        d->next_div = (uint8_t)values[0];
        break;
    case FR_VERB_TRIP:
        if (values[0] > FR_TRIP_CEILING)
            return FR_ABOVE_CEILING;
        d->trip = (uint16_t)values[0];
        break;
    case FR_VERB_FLOOR:
        d->floor = (uint16_t)values[0];
        break;
    case FR_VERB_CEILING:
        d->ceiling = (uint16_t)values[0];
        break;
    case FR_VERB_STILL:
        d->still = (uint16_t)(values[0] / 2);
        break;
    case FR_VERB_FROZEN:
        d->frozen = (uint8_t)values[0];
        d->frozen_ticks = (uint16_t)(values[1] / 2);
        break;
    case FR_VERB_JUMP:
        d->jump = (uint16_t)values[0];
        break;
    case FR_VERB_STALL:
        d->stall = (uint16_t)(values[0] / 2);
        break;
    case FR_VERB_HBMS:
        d->silent = (uint16_t)(values[0] / 2);
        break;
    default:
        return change_state(d, verb, values);
    }
    d->changed = true;
    return FR_OK;
}

static uint8_t execute(famrig *d, uint8_t verb, const char *words)
{
    int32_t values[FR_MAX_NUMBERS] = {0};
    if (verb == FR_VERB_UNKNOWN)
        return FR_UNKNOWN;
    int8_t number = fr_numbers(verb, words, values);
    if (number < 0)
        return FR_NUMBER;
    switch (verb) {
    case FR_VERB_STRICT:
        d->strict = values[0];
        return FR_OK;
    case FR_VERB_BOARD:
        d->latch.board = (uint16_t)values[0];
        d->tell_hello = true;
        return FR_OK;
    case FR_VERB_HELLO:
        d->tell_hello = true; /* fall through */
    case FR_VERB_STATUS:
        d->tell_state = d->tell_settings = true;
        return FR_OK;
    default:
        return change_settings(d, verb, values, (uint8_t)number);
    }
}

/* ---- lines out ---- */

static uint16_t room(const famrig *d)
{
    return FR_SEND_LIMIT - (fr_index)((d->sending_head - d->released) & (FR_SEND_SIZE - 1));
}

static void send_record(famrig *d, uint32_t seq)
{
    if (room(d) < SAMPLE_ROOM) {
        d->dropped++;
        return;
    }
    const fr_record *record = &d->ring[seq % FR_RING];
    fr_begin(d, 'T');
    fr_field(d, d->boot & 15);
    fr_field(d, seq);
    fr_field(d, d->tick - (uint16_t)((uint16_t)d->tick - record->tick));
    fr_field(d, record->pressure_sum);
    fr_field(d, record->pressure_count);
    fr_field(d, record->force_sum);
    fr_field(d, record->output);
    fr_signed_field(d, record->integral);
    fr_field(d, record->flags);
    fr_end(d);
}

static void send_hello(famrig *d)
{
    fr_begin(d, 'H');
    fr_text_field(d, fr_name);
    fr_field(d, FR_PROTOCOL);
    fr_field(d, FR_FIRMWARE);
    fr_field(d, d->boot);
    fr_field(d, d->cause);
    fr_field(d, FR_TICK_HZ);
    fr_field(d, d->div);
    fr_field(d, FR_RING);
    fr_field(d, FR_BYTES_PER_TICK);
    fr_field(d, FR_TRIP_CEILING);
    fr_field(d, d->latch.board);
    fr_end(d);
}

static void send_status(famrig *d)
{
    fr_begin(d, 'S');
    fr_field(d, d->boot);
    fr_field(d, d->seq);
    fr_field(d, d->tick);
    fr_field(d, d->state);
    fr_field(d, d->fault);
    fr_field(d, d->count);
    fr_field(d, d->bad);
    fr_field(d, d->good);
    fr_field(d, d->overrun);
    fr_field(d, d->dropped);
    fr_field(d, d->late);
    fr_field(d, d->tripped_at);
    fr_field(d, d->latch.count);
    fr_field(d, d->latch.output);
    fr_field(d, d->alive);
    fr_end(d);
}

static void send_settings(famrig *d)
{
    const fr_law *law = &d->law;
    fr_begin(d, 'P');
    fr_field(d, d->boot);
    fr_field(d, d->since);
    fr_field(d, (uint32_t)law->set_point);
    fr_field(d, law->feed_forward);
    fr_field(d, law->proportional);
    fr_field(d, law->integral);
    fr_signed_field(d, law->low);
    fr_signed_field(d, law->high);
    fr_field(d, law->zero);
    fr_field(d, law->span);
    fr_field(d, d->div);
    fr_field(d, d->trip);
    fr_field(d, d->jump);
    fr_field(d, d->stall);
    fr_field(d, d->silent);
    fr_field(d, d->floor);
    fr_field(d, d->ceiling);
    fr_field(d, d->still);
    fr_field(d, d->frozen);
    fr_field(d, d->frozen_ticks);
    fr_end(d);
}

static void answer(famrig *d, uint16_t id)
{
    fr_begin(d, 'A');
    fr_field(d, id);
    if (d->last_reason == FR_OK) {
        fr_text_field(d, fr_reason(FR_OK));
        fr_field(d, d->last_seq);
    } else {
        fr_text_field(d, fr_error);
        fr_text_field(d, fr_reason(d->last_reason));
    }
    fr_end(d);
}

/* Sends the next requested record; reports once per request that some are no longer stored. */
static void repeat(famrig *d)
{
    while (d->mask_low || d->mask_high) {
        bool wanted = d->mask_low & 1;
        uint32_t age = d->seq - d->base;
        d->mask_low = d->mask_low >> 1 | d->mask_high << 31;
        d->mask_high >>= 1;
        d->base++;
        if (wanted && age >= 1 && age <= d->kept) {
            send_record(d, d->seq - age);
            return;
        }
        if (wanted && age > d->kept && age < 0x80000000u && !d->told_limits) {
            d->told_limits = true;
            fr_begin(d, 'L');
            fr_field(d, d->seq - d->kept);
            fr_field(d, d->seq);
            fr_end(d);
            return;
        }
    }
}

static void tell(famrig *d)
{
    if (d->tell_hello) {
        d->tell_hello = false;
        send_hello(d);
    } else if (d->tell_state) {
        d->tell_state = false;
        send_status(d);
    } else {
        d->tell_settings = false;
        send_settings(d);
    }
}

static void report(famrig *d)
{
    if (d->tell_hello || d->tell_state || d->tell_settings) {
        bool settings = !d->tell_hello && !d->tell_state && d->tell_settings;
        if (room(d) >= (settings ? SETTINGS_ROOM : REPORT_ROOM))
            tell(d);
    } else if ((d->mask_low || d->mask_high) && room(d) >= REPEAT_ROOM) {
        repeat(d);
    }
}

/* ---- lines in ---- */

/* Executes the line in d->line; returns true if it was answered. */
static bool obey(famrig *d)
{
    bool checked;
    if (d->line_length > FR_LINE_LIMIT || !fr_check(d, &checked)) {
        d->bad++;
        return false;
    }
    const char *words = d->line;
    uint16_t id = fr_id(&words);
    uint8_t verb = fr_verb(&words);
    if (verb == FR_VERB_UNKNOWN && !checked) { /* noise without a CRC does not count as a heartbeat */
        d->bad++;
    } else {
        d->good++;
        d->silence = 0;
    }
    if (verb == FR_VERB_HB)
        return false;
    if (verb == FR_VERB_RP) {
        if (fr_request(d, words))
            d->told_limits = false;
        return false;
    }
    uint16_t check = fr_crc(d->line);
    if (id == 0 || id != d->last_id || check != d->last_check || verb == FR_VERB_HELLO) {
        d->last_reason = execute(d, verb, words);
        d->last_id = id;
        d->last_check = check;
        d->last_seq = in_force(d);
    }
    answer(d, id);
    return true;
}

/* Reads up to the end of one line; returns true if it was answered. */
static bool read_line(famrig *d)
{
    while (d->received_tail != d->received_mark) {
        char byte = (char)d->received[d->received_tail];
        d->received_tail = (d->received_tail + 1) & (FR_RECEIVE_SIZE - 1);
        if (byte != '\n' && byte != '\r') {
            if (byte < ' ' || byte > '~' || d->line_length >= FR_LINE_LIMIT)
                d->line_length = FR_LINE_LIMIT + 1; /* the line is refused, whatever follows */
            else
                d->line[d->line_length++] = byte;
        } else if (d->line_length > 0) {
            bool answered = obey(d);
            d->line_length = 0;
            return answered;
        }
    }
    return false;
}

void famrig_serve(famrig *d)
{
    if (d->fresh)
        send_record(d, d->seq - 1);
    d->fresh = false;
    if (d->tick % FR_TICK_HZ == 0)
        d->tell_state = d->tell_settings = true;
    if (!(room(d) >= ANSWER_ROOM && read_line(d)))
        report(d);
}

/* ---- bytes ---- */

void famrig_receive(famrig *d, uint8_t byte)
{
    uint8_t next = (d->received_head + 1) & (FR_RECEIVE_SIZE - 1);
    if (next == d->received_tail) {
        d->overrun++;
        return;
    }
    d->received[d->received_head] = byte;
    d->received_head = next;
}

void famrig_mark(famrig *d) { d->received_mark = d->received_head; }

void famrig_release(famrig *d)
{
    uint16_t step = FR_SEND_LIMIT - room(d);
    uint16_t lag = (fr_index)((d->released - d->sent) & (FR_SEND_SIZE - 1));
    uint16_t space = FR_SEND_SIZE - FR_SEND_LIMIT - 1 - lag;
    if (step > FR_BYTES_PER_TICK)
        step = FR_BYTES_PER_TICK;
    if (step > space)
        step = space;
    d->released = (d->released + step) & (FR_SEND_SIZE - 1);
}

int16_t famrig_next(famrig *d)
{
    if (d->sent == d->released)
        return -1;
    uint8_t byte = d->sending[d->sent];
    d->sent = (d->sent + 1) & (FR_SEND_SIZE - 1);
    return byte;
}
