
/* --- the plant */

#include <math.h>
#include <stddef.h>
#include "@name@_plant.h"

typedef @name@_state state;

/* Parameters of the circuit, the friction and the viscous loss. */
@NUMBERS@

static const real hold_lengths[@HOLD_LENGTHS@] STORED = {
@HOLD_LENGTH_NODES@
};

static const real hold_pressures[@HOLD_PRESSURES@] STORED = {
@HOLD_PRESSURE_NODES@
};

/* Volume [m3], dV/dL [m2], dV/dP [m3/Pa], d2V/dLdP [m2/Pa] for each pressure at each length. */
static const real hold_nodes[@HOLD_LENGTHS@ * @HOLD_PRESSURES@ * 4] STORED = {
@HOLD_NODES@
};

static real bigger(real a, real b) { return a > b ? a : b; }
static real smaller(real a, real b) { return a < b ? a : b; }
static real size_of(real a) { return a < 0 ? -a : a; }

/* V, V_a, V_b, V_ab one step beyond the table along a: V + dV if V grows, V/(1 - dV/V) if it shrinks. */
static void go_on(real *V, real *a, real *b, real *ab, real step)
{
    if (*a * step >= 0) {
        *V += *a * step;
        *b += *ab * step;
    } else {
        const real r = 1 - *a * step / *V, r_b = -step * (*ab - *a * *b / *V) / *V;
        *b = (*b - *V * r_b / r) / r;
        *ab = (*ab - 2 * *a * r_b / r) / (r * r);
        *a /= r * r;
        *V /= r;
    }
}

/* Volume, and its slopes along the length and the pressure. */
static real holds(real length, real pressure, real slopes[3])
{
    const real L = bigger(stored(hold_lengths), smaller(length, stored(hold_lengths + @HOLD_LENGTHS@ - 1)));
    const real P =
        bigger(stored(hold_pressures), smaller(pressure, stored(hold_pressures + @HOLD_PRESSURES@ - 1)));
    real V = within(hold_lengths, @HOLD_LENGTHS@, hold_pressures, @HOLD_PRESSURES@, hold_nodes, L, P, slopes);
    go_on(&V, slopes, slopes + 1, slopes + 2, length - L);
    go_on(&V, slopes + 1, slopes, slopes + 2, pressure - P);
    return V;
}

real @name@_volume(real length, real pressure)
{
    real slopes[3];
    return holds(length, pressure, slopes);
}

#if defined(c_atmosphere) /* air */
static real share(real drop) /* fraction of the choked flow, ISO 6358; a cubic below a drop of 5 % */
{
    const real slow = R(0.05), width = 1 - c_critical_ratio, last = 1 - slow / width;
    const real joint = R(sqrt(1 - last * last)), secant = joint / slow;
    const real bend = (last / (width * joint) - secant) / (2 * slow * slow);
    const real x = bigger(0, 1 - size_of(drop) / width), psi = R(sqrt(1 - x * x));
    if (size_of(drop) < slow)
        return drop * (secant + bend * (drop * drop - slow * slow));
    return drop < 0 ? -psi : psi;
}

static real passed(real from, real to)
{
    const real high = bigger(from, to);
    return high * share((from - to) / high);
}

static real goal(real signal)
{
    const real above = signal - c_bias, beyond = bigger(size_of(above) - c_dead_band, 0);
    return above > 0 ? beyond / (1 - c_bias - c_dead_band) : -beyond / (c_bias - c_dead_band);
}

static real flow(real pressure, real opening, real dump)
{
    const real p = pressure + c_atmosphere;
    const real fills = c_conductance * (c_leak + bigger(opening, 0));
    const real vents = c_conductance * (c_leak + bigger(-opening, 0)) + c_dump_conductance * dump;
    return R(1e5) * (fills * passed(c_supply + c_atmosphere, p) - vents * passed(p, c_atmosphere)) / p;
}

static real density(real pressure, real before)
{
    return R(exp(log((pressure + c_atmosphere) / (before + c_atmosphere)) / c_exponent));
}

/* (dw/dP)/w */
static real yield(real pressure) { return 1 / (c_exponent * (pressure + c_atmosphere)); }

static real pressure_of(real root) { return root; }
static real root_of(real pressure) { return pressure; }
#else /* water is almost incompressible: its volume needs more digits than a float has */
typedef char water_needs_double[sizeof(real) == 8 ? 1 : -1];

static real pressure_of(real root) { return root * R(sqrt(root * root + 20)); }

static real root_of(real P) { return P * R(sqrt(2 / (20 + sqrt(400 + 4 * P * P)))); }

static real goal(real signal) { return signal; }

static real flow(real pressure, real opening, real dump)
{
    const real over = (pressure - c_relief) / 1000;
    const real relieved = over > 0 ? over + R(log(1 + exp(-over))) : R(log(1 + exp(over)));
    return c_displacement * c_full_speed * opening - (c_needle + c_dump * dump) * root_of(pressure)
        - c_relief_conductance * 1000 * relieved;
}

static real density(real pressure, real before) { return R(exp((pressure - before) / c_bulk_modulus)); }

static real yield(real pressure) { return (void)pressure, 1 / c_bulk_modulus; }
#endif

static real fluid(real length, real pressure, real before)
{
    return (@name@_volume(length, pressure) + c_dead_volume) * density(pressure, before);
}

#if defined(f_travel) /* Dahl's friction: length and z */
static void relaxed(real *memory, real length, real pressure)
{
    (void)pressure;
    memory[0] = length;
    memory[1] = 0;
}

static void slide(real *memory, real length, real pressure)
{
    const real way = length - memory[0], towards = R((way > 0) - (way < 0));
    (void)pressure;
    memory[0] = length;
    memory[1] = towards + (memory[1] - towards) * R(exp(-size_of(way) / f_travel));
}

static real added(const real *memory, real length, real pressure, real force)
{
    (void)length;
    (void)pressure;
    return (f_dry + f_share * force) * memory[1];
}
#elif defined(f_modulus) /* Maxwell-slip elements: coordinates of wall and braid, deflections */
static const real thresholds[@MEMORY@] = {@THRESHOLDS@};
static const real strengths[@MEMORY@] = {@STRENGTHS@};

static void slide(real *memory, real length, real pressure)
{
    real q[2], change;
    int k;
    q[1] = (length / f_rest_length - 1) * pressure / f_modulus;
    q[0] = length / f_rest_length - 1 + q[1];
    for (k = 2; k < @MEMORY@; k++) {
        change = memory[k] + q[k >= 2 + f_wall] - memory[k >= 2 + f_wall];
        memory[k] = bigger(-thresholds[k], smaller(change, thresholds[k]));
    }
    memory[0] = q[0];
    memory[1] = q[1];
}

static real held_by(const real *memory, real pressure)
{
    real force = 0;
    int k;
    for (k = 2; k < @MEMORY@; k++)
        force += strengths[k] * memory[k] / thresholds[k] * (pressure / f_modulus + (k < 2 + f_wall));
    return force;
}

/* Slide to the turning point of the static map's cycle through a state, or to the start of that cycle. */
static void to_end(real *memory, real length, real pressure, int turn)
{
#if f_cycle == 1
    slide(memory, length, turn ? bigger(pressure, f_turn) : smaller(pressure, f_start));
#elif f_cycle == 2
    slide(memory, turn ? smaller(length, f_turn) : bigger(length, f_start), pressure);
#else
    (void)turn;
    slide(memory, length, pressure);
#endif
}

static void relaxed(real *memory, real length, real pressure)
{
    int k;
    to_end(memory, length, pressure, 0);
    for (k = 2; k < @MEMORY@; k++)
        memory[k] = 0;
    if (f_cycled) {
        to_end(memory, length, pressure, 1);
        to_end(memory, length, pressure, 0);
    }
    slide(memory, length, pressure);
}

static real added(const real *memory, real length, real pressure, real force)
{
    real middle[@MEMORY@] = {0}, sum;
    (void)force;
    if (!f_cycle)
        return held_by(memory, pressure);
    relaxed(middle, length, pressure);
    sum = held_by(middle, pressure);
    to_end(middle, length, pressure, 1);
    slide(middle, length, pressure);
    return held_by(memory, pressure) - (sum + held_by(middle, pressure)) / 2;
}
#else
#define relaxed(memory, length, pressure) ((void)(memory[0] = 0))
#define slide(memory, length, pressure) ((void)0)
#define added(memory, length, pressure, force) 0
#endif

void @name@_start(state *at, real length, real pressure)
{
    const state none = {0};
    *at = none;
    at->pressure = pressure;
    at->length = length;
    relaxed(at->memory, length, pressure);
}

void @name@_rates(const state *at, real signal, real dump, real length, real velocity, real rates[3])
{
    real slopes[3];
    const real P = at->pressure, V = holds(length, P, slopes) + c_dead_volume;
    const real swept = slopes[0] * velocity, capacity = slopes[1] + V * yield(P);
    rates[0] = (flow(P, at->opening, at->dump) - swept) / capacity;
    rates[1] = (goal(signal) - at->opening) / c_lag;
    rates[2] = (dump - at->dump) / c_dump_lag;
}

real @name@_pull(const state *at, real length, real velocity)
{
    state now = *at;
    (void)now; /* unused without friction */
    const real force = @name@_force(length, at->pressure);
    slide(now.memory, length, at->pressure);
    return force + added(now.memory, length, at->pressure, force) + f_viscosity * velocity;
}

void @name@_moved(state *at, real length)
{
    slide(at->memory, length, at->pressure);
    at->length = length;
}

/* Root of the pressure at which an implicit stage conserves its fluid, by Newton's method. */
static real solved(real root, real length, real before, real h, real opening, real dump, real held)
{
    const real part = sizeof(real) < 8 ? R(1e-3) : R(1e-7), enough = sizeof(real) < 8 ? R(1e-6) : R(1e-10);
    real change = 1, left[2], scale = 0;
    int k, side;
    for (k = 0; k < 30 && size_of(change) > enough * scale; k++) {
        scale = size_of(root) + root_of(1000);
        for (side = 0; side < 2; side++) {
            const real P = pressure_of(root + R(side) * part * scale);
            left[side] = fluid(length, P, before) - h * flow(P, opening, dump) * density(P, before) - held;
        }
        if (left[1] == left[0])
            break;
        change = left[0] * part * scale / (left[1] - left[0]);
        root -= change;
    }
    return root;
}

void @name@_step(state *at, real signal, real dump, real length, real velocity, real dt)
{
    const real gamma = R(0.29289321881345254), on = (1 - gamma) / gamma, h = gamma * dt;
    const real before = at->pressure, wanted = goal(signal);
    const real behind = at->opening - wanted, dump_behind = at->dump - dump;
    const real held = fluid(at->length, before, before); /* the muscle may have moved since */
    real times[2], now = length, full = held, root = root_of(before);
    int k;
    times[0] = h;
    times[1] = dt;
    for (k = 0; k < 2; k++) {
        at->opening = wanted + behind * R(exp(-times[k] / c_lag));
        at->dump = dump + dump_behind * R(exp(-times[k] / c_dump_lag));
        now = length + velocity * times[k];
        root = solved(root, now, before, h, at->opening, at->dump, full);
        at->pressure = pressure_of(root);
        full = held + on * (fluid(now, at->pressure, before) - held);
    }
    @name@_moved(at, now);
}

const size_t @name@_state_size = sizeof(state);
