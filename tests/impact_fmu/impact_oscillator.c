/* A mass on a spring and a damper between a moving base and a stop, as an FMU of FMI 2.0 or, with FMI3, of FMI 3.0:
     m x'' = -k (x - u) - c (x' - u') - K max(0, x - gap)
   The gap is in mm; u and u' are inputs. As a model exchange it may have a rigid stop of a coefficient of restitution in
   the place of K, and a jump of the velocity at a stated time. From FAULT_TIME on, the parameter `fault` has it misbehave. */

#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#ifdef FMI3
#include "fmi3Functions.h"
typedef fmi3Status Status;
typedef fmi3Float64 Real;
typedef fmi3ValueReference Reference;
enum { OK = fmi3OK, DISCARD = fmi3Discard, ERROR = fmi3Error, FATAL = fmi3Fatal };
#else
#include "fmi2Functions.h"
typedef fmi2Status Status;
typedef fmi2Real Real;
typedef fmi2ValueReference Reference;
enum { OK = fmi2OK, DISCARD = fmi2Discard, ERROR = fmi2Error, FATAL = fmi2Fatal };
#endif

#define INTERNAL_STEP 1e-4 /* s, of the co-simulation */
#define FAULT_TIME 0.05    /* s */
#define KICK 0.1           /* m/s */

enum { TIME, X, V, DER_X, DER_V, BASE, BASE_RATE, MASS, STIFFNESS, DAMPING, GAP, STOP_STIFFNESS, FAULT, X_START,
       RESTITUTION, KICK_TIME, SIZE };
enum { HARMLESS, RETURNS_ERROR, DISCARDS, HANGS, CRASHES, NOT_A_NUMBER, TERMINATES, RETURNS_FATAL };

typedef struct {
    Real value[SIZE];
    int kicked;
#ifdef FMI3
    fmi3LogMessageCallback logger;
    fmi3InstanceEnvironment environment;
#else
    fmi2CallbackFunctions callbacks;
#endif
} Model;

static void message(Model *model, Status status, const char *text) {
#ifdef FMI3
    model->logger(model->environment, status, "error", text);
#else
    model->callbacks.logger(model->callbacks.componentEnvironment, "oscillator", status, "error", "%s", text);
#endif
}

static Real acceleration(const Real *value, Real x, Real v) {
    Real force = -value[STIFFNESS] * (x - value[BASE]) - value[DAMPING] * (v - value[BASE_RATE]);
    Real closed = x - 1e-3 * value[GAP];
    if (closed > 0.0 && value[RESTITUTION] < 0.0) force -= value[STOP_STIFFNESS] * closed;
    return force / value[MASS];
}

static Status fault(Model *model) {
    Real *value = model->value;
    if (value[TIME] < FAULT_TIME) return OK;
    switch ((int)value[FAULT]) {
    case RETURNS_ERROR: message(model, ERROR, "the spring has broken"); return ERROR;
    case DISCARDS: message(model, DISCARD, "the step is too long"); return DISCARD;
    case RETURNS_FATAL: return FATAL;
    case HANGS: for (;;) sleep(1);
    case CRASHES: raise(SIGSEGV); return FATAL;
    case NOT_A_NUMBER: value[X] = NAN; value[V] = NAN; return OK;
    default: return OK;
    }
}

static Status step(Model *model, Real time, Real length) {
    Real *value = model->value;
    int count = (int)ceil(length / INTERNAL_STEP - 1e-9);
    Real h = length / count;
    for (int i = 0; i < count; i++) { /* classical Runge-Kutta */
        Real x = value[X], v = value[V];
        Real a1 = acceleration(value, x, v);
        Real v2 = v + 0.5 * h * a1, a2 = acceleration(value, x + 0.5 * h * v, v2);
        Real v3 = v + 0.5 * h * a2, a3 = acceleration(value, x + 0.5 * h * v2, v3);
        Real v4 = v + h * a3, a4 = acceleration(value, x + h * v3, v4);
        value[X] += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4);
        value[V] += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
    }
    value[TIME] = time + length;
    return fault(model);
}

static int terminates(const Model *model) {
    return model->value[FAULT] == TERMINATES && model->value[TIME] >= FAULT_TIME;
}

static Status get(Model *model, const Reference *references, size_t n, Real *out) {
    for (size_t i = 0; i < n; i++) {
        if (references[i] == DER_X) out[i] = model->value[V];
        else if (references[i] == DER_V) out[i] = acceleration(model->value, model->value[X], model->value[V]);
        else if (references[i] < SIZE) out[i] = model->value[references[i]];
        else return ERROR;
    }
    return OK;
}

static Status set(Model *model, const Reference *references, size_t n, const Real *in) {
    for (size_t i = 0; i < n; i++) {
        if (references[i] >= SIZE) return ERROR;
        if (references[i] == MASS && !(in[i] > 0.0)) {
            message(model, ERROR, "the mass must be positive");
            return ERROR;
        }
        model->value[references[i]] = in[i];
        if (references[i] == X_START) model->value[X] = in[i];
    }
    return OK;
}

static Model *made(void) {
    Model *model = calloc(1, sizeof(Model));
    model->value[MASS] = 1.0;
    model->value[STIFFNESS] = 4000.0;
    model->value[DAMPING] = 8.0;
    model->value[GAP] = 1.0;
    model->value[STOP_STIFFNESS] = 4e4;
    model->value[RESTITUTION] = -1.0;
    return model;
}

static Status states(Model *model, const Real *x) { model->value[X] = x[0]; model->value[V] = x[1]; return OK; }

static Status rates(Model *model, Real *dx) {
    Status status = fault(model);
    dx[0] = model->value[V];
    dx[1] = acceleration(model->value, model->value[X], model->value[V]);
    return status;
}

/* Whether there is a jump to come, and when; at an impact and at the jump the velocity changes. */
static int updated(Model *model, Real *next) {
    Real *value = model->value, e = value[RESTITUTION];
    if (e >= 0.0 && value[X] >= 1e-3 * value[GAP] && value[V] > 0.0) value[V] *= -e;
    if (value[KICK_TIME] <= 0.0 || model->kicked) return 0;
    if (value[TIME] < value[KICK_TIME]) {
        *next = value[KICK_TIME];
        return 1;
    }
    value[V] += KICK;
    model->kicked = 1;
    return 0;
}

static Status indicators(Model *model, Real *z) { z[0] = model->value[X] - 1e-3 * model->value[GAP]; return OK; }

#ifdef FMI3

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
        fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger) {
    Model *model = made();
    model->logger = logger;
    model->environment = environment;
    return model;
}
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
        fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return, const fmi3ValueReference required[],
        size_t n, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
        fmi3IntermediateUpdateCallback update) {
    return fmi3InstantiateModelExchange(name, token, path, visible, logging, environment, logger);
}
void fmi3FreeInstance(fmi3Instance model) { free(model); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance model, fmi3Boolean defined, fmi3Float64 tolerance,
        fmi3Float64 start, fmi3Boolean ends, fmi3Float64 end) {
    ((Model *)model)->value[TIME] = start;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance model) { return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance model) { return fmi3OK; }
fmi3Status fmi3EnterEventMode(fmi3Instance model) { return fmi3OK; }
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance model) { return fmi3OK; }
fmi3Status fmi3GetFloat64(fmi3Instance model, const fmi3ValueReference references[], size_t n, fmi3Float64 values[],
        size_t count) { return get(model, references, n, values); }
fmi3Status fmi3SetFloat64(fmi3Instance model, const fmi3ValueReference references[], size_t n,
        const fmi3Float64 values[], size_t count) { return set(model, references, n, values); }
fmi3Status fmi3DoStep(fmi3Instance model, fmi3Float64 time, fmi3Float64 length, fmi3Boolean keep, fmi3Boolean *event,
        fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    Status status = step(model, time, length);
    *event = fmi3False;
    *terminate = terminates(model);
    *early = fmi3False;
    *last = time + length;
    return status;
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance model, fmi3Boolean *again, fmi3Boolean *terminate,
        fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *timed, fmi3Float64 *next) {
    *again = *nominals = fmi3False;
    *values = fmi3True;
    *timed = updated(model, next);
    *terminate = terminates(model);
    return fmi3OK;
}
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance model, fmi3Boolean keep, fmi3Boolean *event,
        fmi3Boolean *terminate) {
    *event = fmi3False;
    *terminate = terminates(model);
    return fmi3OK;
}
fmi3Status fmi3SetTime(fmi3Instance model, fmi3Float64 time) { ((Model *)model)->value[TIME] = time; return fmi3OK; }
fmi3Status fmi3SetContinuousStates(fmi3Instance model, const fmi3Float64 x[], size_t n) { return states(model, x); }
fmi3Status fmi3GetContinuousStates(fmi3Instance model, fmi3Float64 x[], size_t n) {
    x[0] = ((Model *)model)->value[X];
    x[1] = ((Model *)model)->value[V];
    return fmi3OK;
}
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance model, fmi3Float64 dx[], size_t n) {
    return rates(model, dx);
}
fmi3Status fmi3GetEventIndicators(fmi3Instance model, fmi3Float64 z[], size_t n) { return indicators(model, z); }
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance model, fmi3Float64 x[], size_t n) {
    x[0] = 1e-3;
    x[1] = 1e-1;
    return fmi3OK;
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance model, size_t *n) { *n = 1; return fmi3OK; }
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance model, size_t *n) { *n = 2; return fmi3OK; }

#else

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String path,
        const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    Model *model = made();
    model->callbacks = *callbacks;
    return model;
}
void fmi2FreeInstance(fmi2Component model) { free(model); }
fmi2Status fmi2SetupExperiment(fmi2Component model, fmi2Boolean defined, fmi2Real tolerance, fmi2Real start,
        fmi2Boolean ends, fmi2Real end) {
    ((Model *)model)->value[TIME] = start;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component model) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component model) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component model) { return fmi2OK; }
fmi2Status fmi2EnterEventMode(fmi2Component model) { return fmi2OK; }
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component model) { return fmi2OK; }
fmi2Status fmi2GetReal(fmi2Component model, const fmi2ValueReference references[], size_t n, fmi2Real values[]) {
    return get(model, references, n, values);
}
fmi2Status fmi2SetReal(fmi2Component model, const fmi2ValueReference references[], size_t n,
        const fmi2Real values[]) { return set(model, references, n, values); }
fmi2Status fmi2DoStep(fmi2Component model, fmi2Real time, fmi2Real length, fmi2Boolean keep) {
    Status status = step(model, time, length);
    return terminates(model) ? fmi2Discard : status;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component model, const fmi2StatusKind kind, fmi2Boolean *value) {
    *value = terminates(model);
    return fmi2OK;
}
fmi2Status fmi2NewDiscreteStates(fmi2Component model, fmi2EventInfo *info) {
    info->newDiscreteStatesNeeded = info->nominalsOfContinuousStatesChanged = fmi2False;
    info->valuesOfContinuousStatesChanged = fmi2True;
    info->nextEventTimeDefined = updated(model, &info->nextEventTime);
    info->terminateSimulation = terminates(model);
    return fmi2OK;
}
fmi2Status fmi2CompletedIntegratorStep(fmi2Component model, fmi2Boolean keep, fmi2Boolean *event,
        fmi2Boolean *terminate) {
    *event = fmi2False;
    *terminate = terminates(model);
    return fmi2OK;
}
fmi2Status fmi2SetTime(fmi2Component model, fmi2Real time) { ((Model *)model)->value[TIME] = time; return fmi2OK; }
fmi2Status fmi2SetContinuousStates(fmi2Component model, const fmi2Real x[], size_t n) { return states(model, x); }
fmi2Status fmi2GetContinuousStates(fmi2Component model, fmi2Real x[], size_t n) {
    x[0] = ((Model *)model)->value[X];
    x[1] = ((Model *)model)->value[V];
    return fmi2OK;
}
fmi2Status fmi2GetDerivatives(fmi2Component model, fmi2Real dx[], size_t n) { return rates(model, dx); }
fmi2Status fmi2GetEventIndicators(fmi2Component model, fmi2Real z[], size_t n) { return indicators(model, z); }
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component model, fmi2Real x[], size_t n) {
    x[0] = 1e-3;
    x[1] = 1e-1;
    return fmi2OK;
}

#endif
