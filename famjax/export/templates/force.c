/*
@HEADING@
 */
#include "@name@.h"

typedef @name@_real real;

#define R(x) ((real)(x))
#define LENGTHS @LENGTHS@
#define PRESSURES @PRESSURES@
#define STEPS 60

#if defined(__AVR__)
#include <avr/pgmspace.h>
#define STORED PROGMEM
static real stored(const real *at)
{
    real value;
    memcpy_P(&value, at, sizeof value);
    return value;
}
#else
#define STORED
#define stored(at) (*(at))
#endif

static const real lengths[LENGTHS] STORED = {
@LENGTH_NODES@
};

static const real pressures[PRESSURES] STORED = {
@PRESSURE_NODES@
};

/* Force [N], dF/dL [N/m], dF/dP [m2], d2F/dLdP [m] for each pressure at each length. */
static const real nodes[LENGTHS * PRESSURES * 4] STORED = {
@NODES@
};

static const real shortest_stop = R(@STOP_SHORT@), longest_stop = R(@STOP_LONG@);
static const real stop_stiffness = R(@STOP_STIFFNESS@), stop_onset = R(@STOP_ONSET@);
static const real length_ends[2] = {R(@LENGTH_END_0@), R(@LENGTH_END_1@)};
static const real pressure_ends[2] = {R(@PRESSURE_END_0@), R(@PRESSURE_END_1@)};
static const real slack_width = R(@SLACK@), limit = R(@LIMIT@);
static const real close_enough = sizeof(real) < 8 ? R(2e-7) : R(1e-15);

/* Value and slope of the cubic with the given values and slopes at the ends of a cell. */
static real cubic(real start, real end, real rate, real end_rate, real width, real u, real *slope)
{
    const real rise = end - start, p = width * rate, q = width * end_rate;
    const real square = 3 * rise - 2 * p - q, cube = p + q - 2 * rise;
    *slope = (p + u * (2 * square + 3 * u * cube)) / width;
    return start + u * (p + u * (square + u * cube));
}

/* Cell that contains a value, width of the cell, and position of the value in it, 0 to 1. */
static int cell(const real *at, int count, real value, real *width, real *u)
{
    int low = 0, high = count - 1;
    real start;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (stored(at + middle) <= value)
            low = middle;
        else
            high = middle;
    }
    start = stored(at + low);
    *width = stored(at + high) - start;
    *u = (value - start) / *width;
    return low;
}

/* Step beyond an edge, which bends towards a limit, and its slope; ends are 1/limit. */
static real bent(real step, const real *ends, real *slope)
{
    const real inverse = step < 0 ? ends[0] : ends[1], way = inverse * (step < 0 ? -step : step);
    real t, reached;
    *slope = 1;
    if (!(way > R(0.8)))
        return step;
    t = (way - R(0.8)) * 5;
    *slope = 1 / ((1 + t) * (1 + t));
    reached = (R(0.8) + R(0.2) * t / (1 + t)) / inverse;
    return step < 0 ? -reached : reached;
}

/* Value of a table at a state inside it; slopes along length and pressure, and mixed slope. */
static real within(const real *rows, int count, const real *columns, int width, const real *table,
                   real length, real pressure, real *slopes)
{
    real h, u, g, v, value[2], along[2], rate[2], cross[2];
    const int i = cell(rows, count, length, &h, &u), j = cell(columns, width, pressure, &g, &v);
    int k;
    for (k = 0; k < 2; k++) {
        const real *a = table + (i * width + j + k) * 4, *b = a + width * 4;
        value[k] = cubic(stored(a), stored(b), stored(a + 1), stored(b + 1), h, u, along + k);
        rate[k] = cubic(stored(a + 2), stored(b + 2), stored(a + 3), stored(b + 3), h, u, cross + k);
    }
    *slopes = cubic(along[0], along[1], cross[0], cross[1], g, v, slopes + 2);
    return cubic(value[0], value[1], rate[0], rate[1], g, v, slopes + 1);
}

/* Model force, not clipped at zero; slopes[0] along the length, slopes[1] along the pressure. */
static real model(real length, real pressure, real *slopes)
{
    const real first = stored(lengths), last = stored(lengths + LENGTHS - 1);
    const real low = stored(pressures), high = stored(pressures + PRESSURES - 1);
    const real held = length < first ? first : length > last ? last : length;
    const real at = pressure < low ? low : pressure > high ? high : pressure;
    real inside[3], stiffness, area, mixed, step, slope;
    real force = within(lengths, LENGTHS, pressures, PRESSURES, nodes, held, at, inside);
    int side;
    stiffness = inside[0];
    area = inside[1];
    mixed = inside[2];

    if (length != held) {
        step = bent(length - held, length_ends, &slope);
        if (!(stiffness > 0))
            stiffness = mixed = 0;
        force += stiffness * step;
        area += mixed * step;
        stiffness *= slope;
        mixed *= slope;
    }
    if (pressure != at) {
        step = bent(pressure - at, pressure_ends, &slope);
        if (!(area > 0))
            area = mixed = 0;
        force += area * step;
        stiffness += mixed * step;
        area *= slope;
    }
    for (side = -1; side <= 1; side += 2) {
        step = side < 0 ? shortest_stop - length : length - longest_stop;
        if (step > 0) {
            const real on = step < stop_onset ? step : stop_onset;
            slope = stop_stiffness * (on * on / (2 * stop_onset) + (step - on));
            force += side < 0 ? -slope : slope;
            stiffness += stop_stiffness * on / stop_onset;
        }
    }
    slopes[0] = stiffness;
    slopes[1] = area;
    return force;
}

real @name@_force(real length, real pressure)
{
    real slopes[2];
    const real force = model(length, pressure, slopes), t = force / slack_width;
    return force <= 0 ? 0 : t < 1 ? force * t * (2 - t) : force;
}

real @name@_model_force(real length, real pressure)
{
    real slopes[2];
    return model(length, pressure, slopes);
}

real @name@_stiffness(real length, real pressure)
{
    real slopes[2];
    const real t = model(length, pressure, slopes) / slack_width;
    return t <= 0 ? 0 : t < 1 ? t * (4 - 3 * t) * slopes[0] : slopes[0];
}

real @name@_pressure(real length, real force)
{
    const real part = force / slack_width;
    real low = 0, high = limit, pressure = limit / 2, before = limit, t = 1, wanted, slopes[2];
    int k;

    if (force != force || length != length)
        return force + length;
    wanted = part <= 0 ? 0 : force;
    if (part > 0 && part < 1) {
        for (k = 0; k < STEPS; k++) {
            t -= (t * t * (2 - t) - part) / (t * (4 - 3 * t));
            t = t > 1 ? 1 : t;
        }
        wanted = slack_width * t;
    }
    if (model(length, low, slopes) >= wanted)
        return low;
    if (model(length, high, slopes) <= wanted)
        return high;
    for (k = 0; k < STEPS; k++) {
        const real over = model(length, pressure, slopes) - wanted;
        const int slow = 2 * (over < 0 ? -over : over) > before * slopes[1];
        real step = slow ? 0 : over / slopes[1], next;
        if (over < 0)
            low = pressure;
        else
            high = pressure;
        next = slow ? (low + high) / 2 : pressure - step;
        if (!(low <= next && next <= high))
            next = (low + high) / 2;
        step = next < pressure ? pressure - next : next - pressure;
        pressure = next;
        if (step <= close_enough * limit)
            break;
        before = step;
    }
    return pressure;
}
