/* The functions of FMI 3.0 for co-simulation, over the model in fmu_model.c. */
#include <stdbool.h>
#include <stdint.h>

typedef uint32_t fmi3ValueReference;
typedef fmi3ValueReference Reference;
typedef int32_t Whole;

#include "fmu_model.c"

typedef void *fmi3Instance;
typedef void *fmi3FMUState;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;

static fmi3Status status(int done) { return done ? fmi3OK : fmi3Error; }

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance c, bool on, size_t n, const char *const names[])
{
    (void)c; (void)on; (void)n; (void)names;
    return fmi3OK;
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources,
    bool visible, bool logging, bool events, bool early, const fmi3ValueReference required[], size_t n,
    void *environment, void *log, void *update)
{
    (void)name; (void)resources; (void)visible; (void)logging; (void)events; (void)early; (void)required; (void)n;
    (void)environment; (void)log; (void)update;
    return created(token);
}

EXPORT fmi3Instance fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources,
    bool visible, bool logging, void *environment, void *log)
{
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)environment; (void)log;
    return NULL;
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resources,
    bool visible, bool logging, void *environment, void *log, void *update, void *lock, void *unlock)
{
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)environment; (void)log;
    (void)update; (void)lock; (void)unlock;
    return NULL;
}

EXPORT void fmi3FreeInstance(fmi3Instance c) { free(c); }

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance c, bool tolerant, double tolerance, double start,
    bool stops, double stop)
{
    (void)tolerant; (void)tolerance; (void)stops; (void)stop;
    return status(begin_at((Instance *)c, start));
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return status(show((Instance *)c)); }
EXPORT fmi3Status fmi3EnterEventMode(fmi3Instance c) { (void)c; return fmi3Error; }
EXPORT fmi3Status fmi3Terminate(fmi3Instance c) { (void)c; return fmi3OK; }
EXPORT fmi3Status fmi3Reset(fmi3Instance c) { reset((Instance *)c); return fmi3OK; }

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, double value[], size_t m)
{
    return status((m >= n) && get_reals(c, r, n, value));
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const double value[],
    size_t m)
{
    return status((m >= n) && set_reals(c, r, n, value));
}

EXPORT fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, int32_t value[], size_t m)
{
    return status((m >= n) && get_integers(c, r, n, value));
}

EXPORT fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, const int32_t value[], size_t m)
{
    return status((m >= n) && set_integers(c, r, n, value));
}

/* The other types have no variables here: a call for none of them succeeds. */
#define NONE(what, pointer) \
    EXPORT fmi3Status fmi3Get##what(fmi3Instance c, const fmi3ValueReference r[], size_t n, pointer value[], size_t m) \
    { (void)c; (void)r; (void)value; (void)m; return (n == 0u) ? fmi3OK : fmi3Error; } \
    EXPORT fmi3Status fmi3Set##what(fmi3Instance c, const fmi3ValueReference r[], size_t n, pointer const value[], \
        size_t m) \
    { (void)c; (void)r; (void)value; (void)m; return (n == 0u) ? fmi3OK : fmi3Error; }

NONE(Float32, float)
NONE(Int8, int8_t)
NONE(UInt8, uint8_t)
NONE(Int16, int16_t)
NONE(UInt16, uint16_t)
NONE(UInt32, uint32_t)
NONE(Int64, int64_t)
NONE(UInt64, uint64_t)
NONE(Boolean, bool)
NONE(String, const char *)

EXPORT fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference r[], size_t n, size_t sizes[],
    const uint8_t *value[], size_t m)
{
    (void)c; (void)r; (void)sizes; (void)value; (void)m;
    return (n == 0u) ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference r[], size_t n, const size_t sizes[],
    const uint8_t *const value[], size_t m)
{
    (void)c; (void)r; (void)sizes; (void)value; (void)m;
    return (n == 0u) ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, bool value[])
{
    (void)c; (void)r; (void)value;
    return (n == 0u) ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, const bool value[])
{
    (void)c; (void)r; (void)value;
    return (n == 0u) ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference r, size_t *n)
{
    (void)c; (void)r; (void)n;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference r, size_t of_dependent[],
    fmi3ValueReference independents[], size_t of_independent[], int kinds[], size_t n)
{
    (void)c; (void)r; (void)of_dependent; (void)independents; (void)of_independent; (void)kinds; (void)n;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    return status(keep_state(c, state));
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    return status(restore_state(c, state));
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    (void)c;
    free_state(state);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    (void)c; (void)state;
    *size = SERIALISED;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, uint8_t bytes[], size_t size)
{
    (void)c;
    return status(serialise_state(state, bytes, size));
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const uint8_t bytes[], size_t size, fmi3FMUState *state)
{
    (void)c;
    return status(deserialise_state(bytes, size, state));
}

EXPORT fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n,
    const fmi3ValueReference knowns[], size_t m, const double seed[], size_t seeds, double sensitivity[], size_t sensitivities)
{
    (void)c; (void)unknowns; (void)n; (void)knowns; (void)m; (void)seed; (void)seeds; (void)sensitivity; (void)sensitivities;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n,
    const fmi3ValueReference knowns[], size_t m, const double seed[], size_t seeds, double sensitivity[], size_t sensitivities)
{
    (void)c; (void)unknowns; (void)n; (void)knowns; (void)m; (void)seed; (void)seeds; (void)sensitivity; (void)sensitivities;
    return fmi3Error;
}

EXPORT fmi3Status fmi3EnterConfigurationMode(fmi3Instance c)
{
    (void)c;
    return fmi3Error;
}

EXPORT fmi3Status fmi3ExitConfigurationMode(fmi3Instance c)
{
    (void)c;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n,
    double intervals[], int qualifiers[])
{
    (void)c; (void)r; (void)n; (void)intervals; (void)qualifiers;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference r[], size_t n,
    uint64_t counters[], uint64_t resolutions[], int qualifiers[])
{
    (void)c; (void)r; (void)n; (void)counters; (void)resolutions; (void)qualifiers;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, double shifts[])
{
    (void)c; (void)r; (void)n; (void)shifts;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetShiftFraction(fmi3Instance c, const fmi3ValueReference r[], size_t n,
    uint64_t counters[], uint64_t resolutions[])
{
    (void)c; (void)r; (void)n; (void)counters; (void)resolutions;
    return fmi3Error;
}

EXPORT fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n,
    const double intervals[])
{
    (void)c; (void)r; (void)n; (void)intervals;
    return fmi3Error;
}

EXPORT fmi3Status fmi3SetIntervalFraction(fmi3Instance c, const fmi3ValueReference r[], size_t n,
    const uint64_t counters[], const uint64_t resolutions[])
{
    (void)c; (void)r; (void)n; (void)counters; (void)resolutions;
    return fmi3Error;
}

EXPORT fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n,
    const double shifts[])
{
    (void)c; (void)r; (void)n; (void)shifts;
    return fmi3Error;
}

EXPORT fmi3Status fmi3SetShiftFraction(fmi3Instance c, const fmi3ValueReference r[], size_t n,
    const uint64_t counters[], const uint64_t resolutions[])
{
    (void)c; (void)r; (void)n; (void)counters; (void)resolutions;
    return fmi3Error;
}

EXPORT fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c)
{
    (void)c;
    return fmi3Error;
}

EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, bool *again, bool *terminate, bool *nominals,
    bool *values, bool *defined, double *next)
{
    (void)c; (void)again; (void)terminate; (void)nominals; (void)values; (void)defined; (void)next;
    return fmi3Error;
}

EXPORT fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c)
{
    (void)c;
    return fmi3Error;
}

EXPORT fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, bool no_set, bool *event, bool *terminate)
{
    (void)c; (void)no_set; (void)event; (void)terminate;
    return fmi3Error;
}

EXPORT fmi3Status fmi3SetTime(fmi3Instance c, double now)
{
    (void)c; (void)now;
    return fmi3Error;
}

EXPORT fmi3Status fmi3SetContinuousStates(fmi3Instance c, const double states[], size_t n)
{
    (void)c; (void)states; (void)n;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, double derivatives[], size_t n)
{
    (void)c; (void)derivatives; (void)n;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetEventIndicators(fmi3Instance c, double indicators[], size_t n)
{
    (void)c; (void)indicators; (void)n;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetContinuousStates(fmi3Instance c, double states[], size_t n)
{
    (void)c; (void)states; (void)n;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, double nominals[], size_t n)
{
    (void)c; (void)nominals; (void)n;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n)
{
    (void)c; (void)n;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n)
{
    (void)c; (void)n;
    return fmi3Error;
}

EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    (void)c;
    return fmi3Error;
}

EXPORT fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference r[], size_t n,
    const int32_t orders[], double value[], size_t m)
{
    (void)c; (void)r; (void)n; (void)orders; (void)value; (void)m;
    return fmi3Error;
}

EXPORT fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, double now)
{
    (void)c; (void)clock; (void)now;
    return fmi3Error;
}

EXPORT fmi3Status fmi3DoStep(fmi3Instance c, double now, double size, bool keep, bool *event, bool *terminate,
    bool *early, double *last)
{
    (void)keep;
    *event = false;
    *terminate = false;
    *early = false;
    if (!advance((Instance *)c, now, size)) { return fmi3Error; }
    *last = ((const Instance *)c)->time;
    return fmi3OK;
}
