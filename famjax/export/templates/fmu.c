/*
@HEADING@
 *
 * FMI 2.0, model exchange and co-simulation. Value references: 0 signal, 1 dump, 2 length, 3 velocity,
 * 4 pressure, 5 opening, 6 opening of the dump valve, 7 to 9 their derivatives, 10 force.
 */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include "@name@_plant.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef struct {
    double inputs[4];
    @name@_state at;
    int running;
} instance;

typedef instance *component;
typedef unsigned int reference;
typedef struct {
    int newDiscreteStatesNeeded, terminateSimulation, nominalsChanged, statesChanged, nextEventDefined;
    double nextEventTime;
} event_info;
typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} callbacks;

enum { ok, warning, discard, error };
enum { states = 3, variables = 11, substep = 2 }; /* ms */

/* Functions that always succeed, and functions that are not supported. */
#define ALWAYS(name, arguments) EXPORT int name arguments { return ok; }
#define NEVER(name, arguments) EXPORT int name arguments { return error; }

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

/* Set the friction to that of a muscle at rest, for the inputs and states set before the start. */
static void settle(component c)
{
    const @name@_state set = c->at;
    @name@_start(&c->at, c->inputs[2], set.pressure);
    c->at.opening = set.opening;
    c->at.dump = set.dump;
}

EXPORT int fmi2Reset(component c)
{
    memset(c, 0, sizeof *c);
    c->inputs[0] = @SIGNAL@;
    c->inputs[2] = @LENGTH@;
    settle(c);
    return ok;
}

EXPORT component fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources,
                                 const callbacks *calls, int visible, int logging)
{
    component c = strcmp(guid, "@GUID@") == 0 ? malloc(sizeof *c) : NULL;
    (void)name, (void)kind, (void)resources, (void)calls, (void)visible, (void)logging;
    if (c)
        fmi2Reset(c);
    return c;
}

EXPORT void fmi2FreeInstance(component c) { free(c); }

EXPORT int fmi2ExitInitializationMode(component c)
{
    c->running = 1;
    return ok;
}

static double *variable(component c, reference which)
{
    double *const own[] = {&c->at.pressure, &c->at.opening, &c->at.dump};
    return which < 4 ? c->inputs + which : which < 7 ? own[which - 4] : NULL;
}

EXPORT int fmi2GetDerivatives(component c, double rates[], size_t count)
{
    if (count != states)
        return error;
    @name@_rates(&c->at, c->inputs[0], c->inputs[1], c->inputs[2], c->inputs[3], rates);
    return ok;
}

EXPORT int fmi2GetReal(component c, const reference which[], size_t count, double values[])
{
    double rates[states];
    size_t k;
    for (k = 0; k < count; k++) {
        if (which[k] >= variables)
            return error;
        if (which[k] < 7)
            values[k] = *variable(c, which[k]);
        else if (which[k] == 10)
            values[k] = @name@_pull(&c->at, c->inputs[2], c->inputs[3]);
        else if (fmi2GetDerivatives(c, rates, states) == ok)
            values[k] = rates[which[k] - 7];
    }
    return ok;
}

EXPORT int fmi2SetReal(component c, const reference which[], size_t count, const double values[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        if (which[k] >= 7)
            return error;
        *variable(c, which[k]) = values[k];
    }
    if (!c->running)
        settle(c);
    return ok;
}

EXPORT int fmi2DoStep(component c, double time, double step, int keep)
{
    const int count = (int)(1e3 * step / substep - 1e-9) + 1;
    double *const u = c->inputs;
    int k;
    (void)time, (void)keep;
    for (k = 0; k < count; k++) {
        @name@_step(&c->at, u[0], u[1], u[2], u[3], step / count);
        u[2] = c->at.length;
    }
    return c->at.pressure == c->at.pressure ? ok : error;
}

EXPORT int fmi2GetContinuousStates(component c, double values[], size_t count)
{
    size_t k;
    for (k = 0; k < count; k++)
        values[k] = *variable(c, (reference)k + 4);
    return count == states ? ok : error;
}

EXPORT int fmi2SetContinuousStates(component c, const double values[], size_t count)
{
    size_t k;
    for (k = 0; k < count; k++)
        *variable(c, (reference)k + 4) = values[k];
    return count == states ? ok : error;
}

EXPORT int fmi2GetNominalsOfContinuousStates(component c, double values[], size_t count)
{
    size_t k;
    (void)c;
    for (k = 0; k < count; k++)
        values[k] = k ? 1 : 1e5;
    return ok;
}

EXPORT int fmi2CompletedIntegratorStep(component c, int keep, int *enter_events, int *terminate)
{
    (void)keep;
    *enter_events = *terminate = 0;
    @name@_moved(&c->at, c->inputs[2]);
    return ok;
}

EXPORT int fmi2NewDiscreteStates(component c, event_info *told)
{
    (void)c;
    memset(told, 0, sizeof *told);
    return ok;
}

EXPORT int fmi2GetFMUstate(component c, component *kept)
{
    if (!*kept)
        *kept = malloc(sizeof **kept);
    if (!*kept)
        return error;
    **kept = *c;
    return ok;
}

EXPORT int fmi2SetFMUstate(component c, component kept)
{
    *c = *kept;
    return ok;
}

EXPORT int fmi2FreeFMUstate(component c, component *kept)
{
    (void)c;
    free(*kept);
    *kept = NULL;
    return ok;
}

ALWAYS(fmi2SetDebugLogging, (component c, int on, size_t count, const char *const names[]))
ALWAYS(fmi2SetupExperiment, (component c, int set, double tolerance, double start, int stops, double stop))
ALWAYS(fmi2EnterInitializationMode, (component c))
ALWAYS(fmi2Terminate, (component c))
ALWAYS(fmi2EnterEventMode, (component c))
ALWAYS(fmi2EnterContinuousTimeMode, (component c))
ALWAYS(fmi2SetTime, (component c, double time))
ALWAYS(fmi2GetEventIndicators, (component c, double values[], size_t count))
ALWAYS(fmi2CancelStep, (component c))
NEVER(fmi2GetInteger, (component c, const reference which[], size_t count, int values[]))
NEVER(fmi2GetBoolean, (component c, const reference which[], size_t count, int values[]))
NEVER(fmi2GetString, (component c, const reference which[], size_t count, const char *values[]))
NEVER(fmi2SetInteger, (component c, const reference which[], size_t count, const int values[]))
NEVER(fmi2SetBoolean, (component c, const reference which[], size_t count, const int values[]))
NEVER(fmi2SetString, (component c, const reference which[], size_t count, const char *const values[]))
NEVER(fmi2SerializedFMUstateSize, (component c, component kept, size_t *size))
NEVER(fmi2SerializeFMUstate, (component c, component kept, char bytes[], size_t size))
NEVER(fmi2DeSerializeFMUstate, (component c, const char bytes[], size_t size, component *kept))
NEVER(fmi2GetDirectionalDerivative, (component c, const reference of[], size_t n, const reference by[],
                                     size_t m, const double seed[], double values[]))
NEVER(fmi2SetRealInputDerivatives, (component c, const reference which[], size_t count, const int orders[],
                                    const double values[]))
NEVER(fmi2GetRealOutputDerivatives, (component c, const reference which[], size_t count, const int orders[],
                                     double values[]))
NEVER(fmi2GetStatus, (component c, int kind, int *value))
NEVER(fmi2GetRealStatus, (component c, int kind, double *value))
NEVER(fmi2GetIntegerStatus, (component c, int kind, int *value))
NEVER(fmi2GetBooleanStatus, (component c, int kind, int *value))
NEVER(fmi2GetStringStatus, (component c, int kind, const char **value))
