/* Plausibility of the readings: a live reading varies at rest and follows the output, a frozen one does
 * not. README.md gives the reasons. rig/controller.py does the same in Python. */
#include "famrig_plausibility.h"

#define ONE_COUNT INT32_C(32768) /* one PWM count, in units of the integral */
#define CLOSE_BAND 1       /* counts; a varying reading leaves this band within 0.1 s */
#define WIDE_BAND 2        /* counts; a varying reading leaves this band within a second */
#define REST_BAND 3        /* counts; a varying reading often leaves this band at rest */
#define WATCH_TICKS 1000   /* ticks for which the reading is observed at rest */
#define WATCH_DRIFT 8      /* counts; a larger change is a falling pressure, not noise */
#define ALIVE_MOVES 8      /* smallest number of times that a varying reading leaves its band in that time */
#define ANSWER 5           /* mean counts by which a pressure must respond to the controller */
#define QUICK_CHANGE 8     /* counts in four ticks, faster than strokes change a pressure */
#define QUICK_TICKS 500    /* ticks of a reduced push limit after such a change, a start or a step */
#define OFF 255            /* value of `frozen` that disables the guard */
#define PUSH_LIMIT 75      /* largest excess over the holding output that counts, in PWM counts */
#define FIRST_LIMIT 50     /* the same before the circuit has responded, while its speed is unknown */
#define MOST_PUSH 65000    /* PWM counts * ticks */
#define HEADROOM 2560      /* 1/128 psi; closer to the limit less push is allowed */
#define HELD_SHIFT 9       /* the holding output follows with a time constant of 512 records */
#define SETTLED_SHIFT 7    /* the settled output follows with a time constant of 128 records */
#define CLOSE_TICKS 50     /* ticks for which a lively reading never stays in CLOSE_BAND */
#define LEAP 8             /* counts in one tick, after which no pressure stops within a tick */
#define LEAP_TICKS 20      /* ticks in CLOSE_BAND after a leap, after which the reading is not believed */

static uint16_t distance(uint16_t a, uint16_t b) { return a > b ? a - b : b - a; }

static uint16_t recent_sum(const famrig *d)
{
    uint16_t sum = 0;
    for (uint8_t at = 0; at < FR_JUMP_TICKS; at++)
        sum += d->history[at];
    return sum;
}

/* From now on the pressure must respond, unless it is close to its set point. */
void fr_expect_answer(famrig *d, uint8_t to)
{
    d->asked = to;
    d->answer_push = 0;
    d->answer_held = d->integral;
    d->answer_sum = recent_sum(d);
    d->quick_ticks = QUICK_TICKS;
}

/* Returns true if the reading has left the band, which then restarts from it. */
static bool moved(fr_band *band, uint16_t pressure, uint8_t width)
{
    uint16_t low = pressure < band->low ? pressure : band->low;
    uint16_t high = pressure > band->high ? pressure : band->high;
    bool left = high - low > width;
    band->low = left ? pressure : low;
    band->high = left ? pressure : high;
    return left;
}

/* Observes at rest whether noise changes the reading; only freezing of a varying reading can be detected. */
void fr_watch(famrig *d, uint16_t pressure)
{
    if (d->watch_ticks == 0) {
        d->watch_from = pressure;
        d->moves = 0;
    }
    d->moves += moved(&d->wide, pressure, REST_BAND);
    if (++d->watch_ticks < WATCH_TICKS)
        return;
    d->watch_ticks = 0;
    if (distance(pressure, d->watch_from) > WATCH_DRIFT)
        return;
    d->alive = d->moves >= ALIVE_MOVES ? FR_ALIVE : FR_QUIET;
    d->liveliness = d->moves > FR_LIVELY_MOVES ? FR_LIVELY_MOVES : (uint8_t)d->moves;
}

bool fr_stands_still(famrig *d, uint16_t pressure)
{
    d->still_ticks = moved(&d->wide, pressure, WIDE_BAND) ? 0 : d->still_ticks + 1;
    return d->alive != FR_QUIET &&
           d->still_ticks * (uint32_t)d->liveliness >= d->still * (uint32_t)FR_LIVELY_MOVES;
}

/* Sum over time of the output's excess over the holding output [counts * ticks]. */
static uint16_t pushed(const famrig *d, uint16_t push, int32_t held, uint8_t slack)
{
    int16_t holding = (int16_t)((d->law.feed_forward * INT32_C(128) + held + ONE_COUNT / 2) >> 15);
    int16_t excess = d->output - slack - holding;
    int16_t limit = d->asked == FR_A_START ? FIRST_LIMIT : PUSH_LIMIT;
    if (excess > limit)
        excess = limit;
    if (excess < 0)
        return push < (uint16_t)-excess ? 0 : push + excess;
    return push < MOST_PUSH ? push + excess : push;
}

static uint32_t push_budget(const famrig *d) { return d->frozen * (uint32_t)d->frozen_ticks; }

/* Returns true if this push is too large for a constant reading. The threshold is lower close to the limit
 * and after a leap. It is higher when nothing has happened for a while, because strokes may explain a
 * constant reading, and for a quiet reading, which rests between two counts. */
static bool too_much(const famrig *d, uint16_t push, int32_t error)
{
    int32_t headroom = d->leapt ? 0 : d->headroom + error / 2; /* after a leap it may be at the limit */
    if (headroom > HEADROOM)
        headroom = HEADROOM;
    if (headroom < HEADROOM / 4)
        headroom = HEADROOM / 4;
    uint8_t share = (d->quick_ticks ? 1 : 2) << (d->alive == FR_QUIET && d->asked != FR_A_START);
    return push * (uint32_t)HEADROOM >= push_budget(d) * share * (uint32_t)headroom;
}

/* A pressure follows an output above the holding output; a reading that does not is frozen. */
bool fr_is_frozen(famrig *d, uint16_t pressure, int32_t error)
{
    d->close_ticks++;
    uint16_t before = d->close.low;
    if (moved(&d->close, pressure, CLOSE_BAND)) {
        d->held = d->integral;
        d->leapt = distance(pressure, before) > LEAP;
        d->close_ticks = d->push = d->wound_push = 0;
    }
    if (distance(pressure, d->history[d->oldest]) >= QUICK_CHANGE)
        d->quick_ticks = QUICK_TICKS;
    else if (d->quick_ticks)
        d->quick_ticks--;
    int32_t least = d->settled < d->held ? d->settled : d->held;
    d->push = pushed(d, d->push, d->held, d->frozen);
    d->wound_push = pushed(d, d->wound_push, least, d->frozen == OFF ? OFF : 0);
    if (d->phase == d->div) {
        d->held += (d->integral - d->held) >> HELD_SHIFT;
        d->settled += (d->integral - d->settled) >> SETTLED_SHIFT;
    }
    uint16_t enough = (d->leapt ? LEAP_TICKS : CLOSE_TICKS) * FR_LIVELY_MOVES;
    bool wound = d->alive != FR_QUIET && d->close_ticks * (uint32_t)d->liveliness >= enough;
    return too_much(d, d->push, error) || (wound && too_much(d, d->wound_push, error));
}

/* After a start or a higher set point, the mean of several readings must change; noise is not a response.
 * A reading that is quiet at rest may already be frozen, so its limit is lower. */
bool fr_no_answer(famrig *d, int32_t error)
{
    if (d->asked == FR_NOTHING)
        return false;
    bool quiet = d->alive == FR_QUIET;
    uint8_t slack = quiet && d->frozen != OFF ? d->frozen / 4 : d->frozen;
    d->answer_push = pushed(d, d->answer_push, d->answer_held, slack);
    if (d->answer_push >= push_budget(d) << (d->asked == FR_A_STEP))
        return true;
    if (distance(recent_sum(d), d->answer_sum) >= ANSWER * FR_JUMP_TICKS ||
        (d->phase == d->div && error <= (d->law.span * (int32_t)(quiet ? 1 : ANSWER)) >> 9))
        d->asked = FR_NOTHING;
    return false;
}
