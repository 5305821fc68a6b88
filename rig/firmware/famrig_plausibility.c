/* Plausibility of the readings: a live one varies at rest and follows the output, a frozen one does not;
 * the reasons are in README.md. rig/device/plausibility.py is the same in Python. */
#include "famrig_plausibility.h"

#define ONE_COUNT INT32_C(32768) /* of the integral */
#define CLOSE_BAND 1       /* counts within which a reading that varies does not stay for 0.1 s */
#define WIDE_BAND 2        /* the same for a second */
#define REST_BAND 3        /* left often by a reading that is alive, at rest */
#define WATCH_TICKS 1000   /* for which the reading is watched at rest */
#define WATCH_DRIFT 8      /* counts: more is a pressure that falls, not noise */
#define ALIVE_MOVES 8      /* times that it leaves its band in that time, at least */
#define ANSWER 5           /* counts by which a pressure answers the controller, in the mean */
#define QUICK_CHANGE 8     /* counts in four ticks: faster than strokes move a pressure */
#define QUICK_TICKS 500    /* for which less push is allowed after that, a start or a step */
#define OFF 255            /* of `frozen` */
#define PUSH_LIMIT 75      /* PWM counts above the holding output that count at most */
#define FIRST_LIMIT 50     /* the same before the circuit has answered: how slow it is is not known */
#define MOST_PUSH 65000    /* PWM counts * ticks */
#define HEADROOM 2560      /* 1/128 psi: with less below the limit less push is allowed */
#define HELD_SHIFT 9       /* the holding output follows with a time constant of 512 records */
#define SETTLED_SHIFT 7    /* the settled one, which knows nothing of a wound integral, of 128 */
#define CLOSE_TICKS 50     /* for which a lively reading is never within CLOSE_BAND */
#define LEAP 8             /* counts in one tick: no pressure stops within a tick after that */
#define LEAP_TICKS 20      /* within CLOSE_BAND after a leap: the reading is not the pressure's */

static uint16_t distance(uint16_t a, uint16_t b) { return a > b ? a - b : b - a; }

static uint16_t recent_sum(const famrig *d)
{
    uint16_t sum = 0;
    for (uint8_t at = 0; at < FR_JUMP_TICKS; at++)
        sum += d->history[at];
    return sum;
}

/* From here on the pressure has to answer; one that is within reach of its set point need not. */
void fr_expect_answer(famrig *d, uint8_t to)
{
    d->asked = to;
    d->answer_push = 0;
    d->answer_held = d->integral;
    d->answer_sum = recent_sum(d);
    d->quick_ticks = QUICK_TICKS;
}

/* Whether the reading has left the band, which then begins anew with it. */
static bool moved(fr_band *band, uint16_t pressure, uint8_t width)
{
    uint16_t low = pressure < band->low ? pressure : band->low;
    uint16_t high = pressure > band->high ? pressure : band->high;
    bool left = high - low > width;
    band->low = left ? pressure : low;
    band->high = left ? pressure : high;
    return left;
}

/* At rest: does noise move the reading? Only of one that is alive can it be said that it froze. */
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

/* What the output has pushed so far [counts * ticks], from what exceeds the one that held. */
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

/* Whether that is more than a pressure bears that does not move: less where its limit is near, or may
 * have been before the reading leapt; more where nothing has happened for a while, so that strokes
 * explain it, and of a quiet reading, which rests on its way between two counts. */
static bool too_much(const famrig *d, uint16_t push, int32_t error)
{
    int32_t headroom = d->leapt ? 0 : d->headroom + error / 2; /* it may have been at the limit */
    if (headroom > HEADROOM)
        headroom = HEADROOM;
    if (headroom < HEADROOM / 4)
        headroom = HEADROOM / 4;
    uint8_t share = (d->quick_ticks ? 1 : 2) << (d->alive == FR_QUIET && d->asked != FR_A_START);
    return push * (uint32_t)HEADROOM >= push_budget(d) * share * (uint32_t)headroom;
}

/* A pressure follows an output that is above the holding one; a reading that does not is frozen. */
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

/* After a start and a higher set point: noise is no answer, the mean of some readings has to move. One
 * that is quiet at rest may be frozen already: little is granted to it. */
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
