"""An FMU of version 2.0 for co-simulation and model exchange, written by hand: the motor of `foreign_models`.

One state, the speed; the voltage is given in mV and the speed in degrees per second. With an inertia above 0.13 g m2 it
ends its process; with a drag above 2e-4 N m s a step fails.
"""

import subprocess
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

from deatwin.plant.export.archive import headers

SOURCE = r"""
#include <math.h>
#include <stdlib.h>
#include "fmi2FunctionTypes.h"
enum { TIME, VOLTAGE, SPEED, RATE, RESISTANCE, CONSTANT, INERTIA, DRAG, COUNT };
#define DEGREES 57.29577951308232
typedef struct { double v[COUNT]; fmi2CallbackLogger log; fmi2ComponentEnvironment who; } Motor;
static double rate(Motor *m) {
    return -(m->v[CONSTANT] * m->v[CONSTANT] / m->v[RESISTANCE] + m->v[DRAG]) / m->v[INERTIA];
}
static double push(Motor *m) { return m->v[CONSTANT] * 1e-3 * m->v[VOLTAGE] / m->v[RESISTANCE] / m->v[INERTIA]; }
static void derive(Motor *m) { m->v[RATE] = rate(m) * m->v[SPEED] + DEGREES * push(m); }
const char *fmi2GetVersion(void) { return "2.0"; }
const char *fmi2GetTypesPlatform(void) { return "default"; }
fmi2Component fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String g, fmi2String r, const fmi2CallbackFunctions *f,
                              fmi2Boolean v, fmi2Boolean l) {
    Motor *m = calloc(1, sizeof *m);
    double start[COUNT] = {0, 0, 0, 0, 2.0, 0.048, 1e-4, 1e-5};
    for (int k = 0; k < COUNT; k++) m->v[k] = start[k];
    m->log = f->logger; m->who = f->componentEnvironment;
    return m;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean b, size_t n, const fmi2String s[]) { return fmi2OK; }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean d, fmi2Real t, fmi2Real s, fmi2Boolean e, fmi2Real p) {
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    if (((Motor *)c)->v[INERTIA] > 1.3e-4) _Exit(11);
    return fmi2OK;
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real x[]) {
    for (size_t k = 0; k < n; k++) ((Motor *)c)->v[r[k]] = x[k];
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real x[]) {
    derive(c);
    for (size_t k = 0; k < n; k++) x[k] = ((Motor *)c)->v[r[k]];
    return fmi2OK;
}
fmi2Status fmi2EnterEventMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *e) {
    e->newDiscreteStatesNeeded = e->terminateSimulation = e->nominalsOfContinuousStatesChanged = fmi2False;
    e->valuesOfContinuousStatesChanged = e->nextEventTimeDefined = fmi2False;
    return fmi2OK;
}
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean b, fmi2Boolean *e, fmi2Boolean *t) {
    *e = *t = fmi2False;
    return fmi2OK;
}
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real t) { return fmi2OK; }
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
    ((Motor *)c)->v[SPEED] = x[0];
    return fmi2OK;
}
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) { x[0] = ((Motor *)c)->v[SPEED]; return fmi2OK; }
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real x[], size_t n) { derive(c); x[0] = ((Motor *)c)->v[RATE]; return fmi2OK; }
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x[], size_t n) { x[0] = 1000.0; return fmi2OK; }
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real x[], size_t n) { return fmi2OK; }
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean b) {
    Motor *m = c;
    double kept = exp(rate(m) * h);
    if (m->v[DRAG] > 2e-4) {
        m->log(m->who, "motor", fmi2Error, "error", "the bearings have seized");
        return fmi2Error;
    }
    m->v[SPEED] = kept * m->v[SPEED] + (kept - 1) / rate(m) * DEGREES * push(m);
    return fmi2OK;
}
#define ABSENT(name) fmi2Status name(void) { return fmi2Error; }
ABSENT(fmi2CancelStep) ABSENT(fmi2GetStatus) ABSENT(fmi2GetRealStatus) ABSENT(fmi2GetIntegerStatus)
ABSENT(fmi2GetBooleanStatus) ABSENT(fmi2GetStringStatus) ABSENT(fmi2SetRealInputDerivatives)
ABSENT(fmi2GetRealOutputDerivatives) ABSENT(fmi2GetInteger) ABSENT(fmi2GetBoolean) ABSENT(fmi2GetString)
ABSENT(fmi2SetInteger) ABSENT(fmi2SetBoolean) ABSENT(fmi2SetString) ABSENT(fmi2GetFMUstate) ABSENT(fmi2SetFMUstate)
ABSENT(fmi2FreeFMUstate) ABSENT(fmi2SerializedFMUstateSize) ABSENT(fmi2SerializeFMUstate)
ABSENT(fmi2DeSerializeFMUstate) ABSENT(fmi2GetDirectionalDerivative)
"""
PARAMETERS = (("resistance", "2.0"), ("constant", "0.048"), ("inertia", "1e-4"), ("drag", "1e-5"))
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="motor" guid="motor" numberOfEventIndicators="0">
  <ModelExchange modelIdentifier="motor"/>
  <CoSimulation modelIdentifier="motor" canHandleVariableCommunicationStepSize="true"/>
  <UnitDefinitions><Unit name="mV"/><Unit name="deg/s"/><Unit name="N.m.s"/></UnitDefinitions>
  <TypeDefinitions><SimpleType name="Speed"><Real unit="deg/s"/></SimpleType></TypeDefinitions>
  <ModelVariables>
    <ScalarVariable name="time" valueReference="0" causality="independent" variability="continuous"><Real/></ScalarVariable>
    <ScalarVariable name="voltage" valueReference="1" causality="input"><Real unit="mV" start="0"/></ScalarVariable>
    <ScalarVariable name="speed" valueReference="2" causality="output"><Real declaredType="Speed"/></ScalarVariable>
    <ScalarVariable name="der(speed)" valueReference="3" causality="local"><Real derivative="3"/></ScalarVariable>
    {parameters}
  </ModelVariables>
  <ModelStructure>
    <Outputs><Unknown index="3"/></Outputs>
    <Derivatives><Unknown index="4"/></Derivatives>
  </ModelStructure>
</fmiModelDescription>
"""
PARAMETER = (
    '<ScalarVariable name="{name}" valueReference="{number}" causality="parameter" variability="tunable">'
    '<Real start="{start}" min="0"/></ScalarVariable>'
)


def build(path: Path, compiler: str) -> Path:
    """Compile and zip the FMU for Linux on this processor."""
    rows = [PARAMETER.format(name=n, number=k, start=start) for k, (n, start) in enumerate(PARAMETERS, start=4)]
    with TemporaryDirectory() as folder:
        (Path(folder) / "motor.c").write_text(SOURCE)
        command = [compiler, "-shared", "-fPIC", "-O1", f"-I{headers()}", "motor.c", "-o", "motor.so", "-lm"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", DESCRIPTION.format(parameters="\n    ".join(rows)))
            archive.write(Path(folder) / "motor.so", "binaries/linux64/motor.so")
    return path
