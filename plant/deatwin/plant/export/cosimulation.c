/* FMI 3.0 for co-simulation around a sampled system (see deatwin.plant.export.sampled for its functions).
 *
 * Before this text stand the system's source and
 *   MODEL_TOKEN, MODEL_INPUTS, MODEL_OUTPUTS, MODEL_SAMPLE_TIME, model_state, model_init, model_step, model_start
 * A step of communication takes as many samples as it is long; inputs are held over it. Value references: 0 is time,
 * then inputs, then outputs.
 */
#include <math.h>
#include <string.h>
#include <fmi3Functions.h>

enum { FIRST_OUTPUT = 1 + MODEL_INPUTS, VARIABLES = FIRST_OUTPUT + MODEL_OUTPUTS };

typedef struct {
    model_state state;
    double values[VARIABLES];
    double start;
    long count; /* This counts the samples since the start. */
} instance_t;

static const double OFF_GRID = 1e-6; /* A communication point may miss a sample by this share of a sample, because of rounding. */

FMI3_Export const char *fmi3GetVersion(void) { return "3.0"; }

FMI3_Export fmi3Status fmi3Reset(fmi3Instance instance)
{
    instance_t *m = (instance_t *)instance;
    model_init(&m->state);
    memcpy(m->values, model_start, sizeof(m->values));
    m->start = 0.0;
    m->count = 0;
    return fmi3OK;
}

FMI3_Export fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t n_required,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    instance_t *m;
    (void)name; (void)resources; (void)visible; (void)logging; (void)events; (void)early; (void)required;
    (void)n_required; (void)environment; (void)log; (void)update;
    if (strcmp(token, MODEL_TOKEN) != 0) return NULL; /* The description belongs to another model. */
    m = (instance_t *)malloc(sizeof(instance_t));
    if (m) fmi3Reset(m);
    return m;
}

FMI3_Export void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

FMI3_Export fmi3Status fmi3EnterInitializationMode(
    fmi3Instance instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean has_stop,
    fmi3Float64 stop)
{
    instance_t *m = (instance_t *)instance;
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    m->start = start;
    m->values[0] = start;
#ifdef MODEL_CLOCK
    m->state.start = start;
#endif
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) { (void)instance; return fmi3OK; }
FMI3_Export fmi3Status fmi3Terminate(fmi3Instance instance) { (void)instance; return fmi3OK; }

FMI3_Export fmi3Status fmi3SetDebugLogging(
    fmi3Instance instance, fmi3Boolean on, size_t n_categories, const fmi3String categories[])
{
    (void)instance; (void)on; (void)n_categories; (void)categories;
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3GetFloat64(
    fmi3Instance instance, const fmi3ValueReference references[], size_t n_references, fmi3Float64 values[],
    size_t n_values)
{
    const instance_t *m = (const instance_t *)instance;
    size_t i;
    if (n_values != n_references) return fmi3Error;
    for (i = 0; i < n_references; i++) {
        if (references[i] >= VARIABLES) return fmi3Error;
        values[i] = m->values[references[i]];
    }
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3SetFloat64(
    fmi3Instance instance, const fmi3ValueReference references[], size_t n_references, const fmi3Float64 values[],
    size_t n_values)
{
    instance_t *m = (instance_t *)instance;
    size_t i;
    if (n_values != n_references) return fmi3Error;
    for (i = 0; i < n_references; i++) {
        if (references[i] < 1 || references[i] >= FIRST_OUTPUT) return fmi3Error; /* Only inputs can be set. */
        m->values[references[i]] = values[i];
    }
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3DoStep(
    fmi3Instance instance, fmi3Float64 time, fmi3Float64 width, fmi3Boolean no_return, fmi3Boolean *event,
    fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    instance_t *m = (instance_t *)instance;
    const double samples = (time + width - m->start) / MODEL_SAMPLE_TIME;
    const double whole = floor(samples + 0.5);
    model_real u[MODEL_INPUTS], y[MODEL_OUTPUTS];
    fmi3Status status = fmi3OK;
    int i;
    (void)no_return;
    *event = fmi3False;
    *terminate = fmi3False;
    *early = fmi3False;
    /* The importer's communication points must coincide with samples. */
    if (fabs(samples - whole) > OFF_GRID * (1.0 + fabs(whole) * 1e-3) || whole < (double)m->count) return fmi3Error;
    for (i = 0; i < MODEL_INPUTS; i++) u[i] = (model_real)m->values[1 + i];
    while (status == fmi3OK && (double)m->count < whole) {
        if (model_step(&m->state, u, y)) {
            status = fmi3Error;
        } else {
            m->count += 1;
            for (i = 0; i < MODEL_OUTPUTS; i++) m->values[FIRST_OUTPUT + i] = (double)y[i];
        }
    }
    m->values[0] = m->start + (double)m->count * MODEL_SAMPLE_TIME;
    *reached = m->values[0];
    return status;
}

FMI3_Export fmi3Status fmi3GetFMUState(fmi3Instance i, fmi3FMUState *s) { (void)i; (void)s; return fmi3Error; }
FMI3_Export fmi3Status fmi3SetFMUState(fmi3Instance i, fmi3FMUState s) { (void)i; (void)s; return fmi3Error; }
FMI3_Export fmi3Status fmi3FreeFMUState(fmi3Instance i, fmi3FMUState *s) { (void)i; (void)s; return fmi3Error; }

/* FMI 3.0 requires these functions, which this kind of FMU never uses. */
#define UNUSED(function, ...) FMI3_Export fmi3Status function(__VA_ARGS__) { return fmi3Error; }
#define REFERENCES fmi3Instance i, const fmi3ValueReference r[], size_t n
#define OF_TYPE(type) \
    UNUSED(fmi3Get##type, REFERENCES, fmi3##type values[], size_t n_values) \
    UNUSED(fmi3Set##type, REFERENCES, const fmi3##type values[], size_t n_values)

OF_TYPE(Float32)
OF_TYPE(Int8)
OF_TYPE(UInt8)
OF_TYPE(Int16)
OF_TYPE(UInt16)
OF_TYPE(Int32)
OF_TYPE(UInt32)
OF_TYPE(Int64)
OF_TYPE(UInt64)
OF_TYPE(Boolean)
OF_TYPE(String)
UNUSED(fmi3GetBinary, REFERENCES, size_t sizes[], fmi3Binary values[], size_t n_values)
UNUSED(fmi3SetBinary, REFERENCES, const size_t sizes[], const fmi3Binary values[], size_t n_values)
UNUSED(fmi3GetClock, REFERENCES, fmi3Clock values[])
UNUSED(fmi3SetClock, REFERENCES, const fmi3Clock values[])
UNUSED(fmi3GetNumberOfVariableDependencies, fmi3Instance i, fmi3ValueReference r, size_t *n)
UNUSED(fmi3GetVariableDependencies, fmi3Instance i, fmi3ValueReference r, size_t of[], fmi3ValueReference on[],
       size_t at[], fmi3DependencyKind kinds[], size_t n)
UNUSED(fmi3SerializedFMUStateSize, fmi3Instance i, fmi3FMUState s, size_t *n)
UNUSED(fmi3SerializeFMUState, fmi3Instance i, fmi3FMUState s, fmi3Byte bytes[], size_t n)
UNUSED(fmi3DeserializeFMUState, fmi3Instance i, const fmi3Byte bytes[], size_t n, fmi3FMUState *s)
UNUSED(fmi3GetDirectionalDerivative, REFERENCES, const fmi3ValueReference known[], size_t n_known,
       const fmi3Float64 seed[], size_t n_seed, fmi3Float64 slope[], size_t n_slope)
UNUSED(fmi3GetAdjointDerivative, REFERENCES, const fmi3ValueReference known[], size_t n_known,
       const fmi3Float64 seed[], size_t n_seed, fmi3Float64 slope[], size_t n_slope)
UNUSED(fmi3EnterEventMode, fmi3Instance i)
UNUSED(fmi3EnterConfigurationMode, fmi3Instance i)
UNUSED(fmi3ExitConfigurationMode, fmi3Instance i)
UNUSED(fmi3GetIntervalDecimal, REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
UNUSED(fmi3GetIntervalFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
       fmi3IntervalQualifier qualifiers[])
UNUSED(fmi3GetShiftDecimal, REFERENCES, fmi3Float64 shifts[])
UNUSED(fmi3GetShiftFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
UNUSED(fmi3SetIntervalDecimal, REFERENCES, const fmi3Float64 intervals[])
UNUSED(fmi3SetIntervalFraction, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
UNUSED(fmi3SetShiftDecimal, REFERENCES, const fmi3Float64 shifts[])
UNUSED(fmi3SetShiftFraction, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
UNUSED(fmi3EvaluateDiscreteStates, fmi3Instance i)
UNUSED(fmi3UpdateDiscreteStates, fmi3Instance i, fmi3Boolean *again, fmi3Boolean *stop, fmi3Boolean *nominals,
       fmi3Boolean *states, fmi3Boolean *has_next, fmi3Float64 *next)
UNUSED(fmi3EnterContinuousTimeMode, fmi3Instance i)
UNUSED(fmi3CompletedIntegratorStep, fmi3Instance i, fmi3Boolean no_return, fmi3Boolean *event, fmi3Boolean *stop)
UNUSED(fmi3SetTime, fmi3Instance i, fmi3Float64 time)
UNUSED(fmi3SetContinuousStates, fmi3Instance i, const fmi3Float64 states[], size_t n)
UNUSED(fmi3GetContinuousStateDerivatives, fmi3Instance i, fmi3Float64 rates[], size_t n)
UNUSED(fmi3GetEventIndicators, fmi3Instance i, fmi3Float64 indicators[], size_t n)
UNUSED(fmi3GetContinuousStates, fmi3Instance i, fmi3Float64 states[], size_t n)
UNUSED(fmi3GetNominalsOfContinuousStates, fmi3Instance i, fmi3Float64 nominals[], size_t n)
UNUSED(fmi3GetNumberOfEventIndicators, fmi3Instance i, size_t *n)
UNUSED(fmi3GetNumberOfContinuousStates, fmi3Instance i, size_t *n)
UNUSED(fmi3EnterStepMode, fmi3Instance i)
UNUSED(fmi3GetOutputDerivatives, REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[], size_t n_values)
UNUSED(fmi3ActivateModelPartition, fmi3Instance i, fmi3ValueReference clock, fmi3Float64 time)

FMI3_Export fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)environment; (void)log;
    return NULL;
}

FMI3_Export fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)environment; (void)log;
    (void)update; (void)lock; (void)unlock;
    return NULL;
}
