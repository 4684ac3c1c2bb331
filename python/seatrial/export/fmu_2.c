/* The functions of FMI 2.0 for co-simulation, over the model in fmu_model.c. */
typedef unsigned int fmi2ValueReference;
typedef fmi2ValueReference Reference;
typedef int Whole;

#include "fmu_model.c"

typedef void *fmi2Component;
typedef void *fmi2FMUstate;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;

static fmi2Status status(int done) { return done ? fmi2OK : fmi2Error; }

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[])
{
    (void)c; (void)on; (void)n; (void)names;
    return fmi2OK;
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, int type, fmi2String guid, fmi2String resources,
    const void *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name; (void)resources; (void)functions; (void)visible; (void)logging;
    /* 1 is co-simulation */
    return (type == 1) ? created(guid) : NULL;
}

EXPORT void fmi2FreeInstance(fmi2Component c) { free(c); }

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start,
    fmi2Boolean stops, fmi2Real stop)
{
    (void)tolerant; (void)tolerance; (void)stops; (void)stop;
    return status(begin_at((Instance *)c, start));
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return status(show((Instance *)c)); }
EXPORT fmi2Status fmi2Terminate(fmi2Component c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2Reset(fmi2Component c) { reset((Instance *)c); return fmi2OK; }

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real value[])
{
    return status(get_reals(c, r, n, value));
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real value[])
{
    return status(set_reals(c, r, n, value));
}

EXPORT fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer value[])
{
    return status(get_integers(c, r, n, value));
}

EXPORT fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer value[])
{
    return status(set_integers(c, r, n, value));
}

EXPORT fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean value[])
{
    (void)c; (void)r; (void)value;
    return (n == 0u) ? fmi2OK : fmi2Error;
}

EXPORT fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Boolean value[])
{
    (void)c; (void)r; (void)value;
    return (n == 0u) ? fmi2OK : fmi2Error;
}

EXPORT fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String value[])
{
    (void)c; (void)r; (void)value;
    return (n == 0u) ? fmi2OK : fmi2Error;
}

EXPORT fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String value[])
{
    (void)c; (void)r; (void)value;
    return (n == 0u) ? fmi2OK : fmi2Error;
}

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    return status(keep_state(c, state));
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    return status(restore_state(c, state));
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free_state(state);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c; (void)state;
    *size = SERIALISED;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    (void)c;
    return status(serialise_state(state, bytes, size));
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    (void)c;
    return status(deserialise_state(bytes, size, state));
}

EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n,
    const fmi2ValueReference known[], size_t m, const fmi2Real seed[], fmi2Real sensitivity[])
{
    (void)c; (void)unknown; (void)n; (void)known; (void)m; (void)seed; (void)sensitivity;
    return fmi2Error;
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
    const fmi2Integer order[], const fmi2Real value[])
{
    (void)c; (void)r; (void)n; (void)order; (void)value;
    return fmi2Error;
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
    const fmi2Integer order[], fmi2Real value[])
{
    (void)c; (void)r; (void)n; (void)order; (void)value;
    return fmi2Error;
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real size, fmi2Boolean keep)
{
    (void)keep;
    return status(advance((Instance *)c, now, size));
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c) { (void)c; return fmi2Error; }
EXPORT fmi2Status fmi2GetStatus(fmi2Component c, int kind, fmi2Status *value) { (void)c; (void)kind; (void)value; return fmi2Discard; }
EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, int kind, fmi2Real *value) { (void)c; (void)kind; (void)value; return fmi2Discard; }
EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component c, int kind, fmi2Integer *value) { (void)c; (void)kind; (void)value; return fmi2Discard; }
EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component c, int kind, fmi2Boolean *value) { (void)c; (void)kind; (void)value; return fmi2Discard; }
EXPORT fmi2Status fmi2GetStringStatus(fmi2Component c, int kind, fmi2String *value) { (void)c; (void)kind; (void)value; return fmi2Discard; }
