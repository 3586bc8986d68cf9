"""An FMU of version 3.0 for co-simulation and model exchange, written by hand: the motor of `foreign_models`.

One state, the speed; the voltage is given in mV and the speed in degrees per second.
"""

import re
import subprocess
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

from fmi2 import PARAMETERS

from deatwin.plant.export.archive import headers

SOURCE = r"""
#include <math.h>
#include <stdlib.h>
#include "fmi3FunctionTypes.h"
enum { TIME, VOLTAGE, SPEED, RATE, RESISTANCE, CONSTANT, INERTIA, DRAG, COUNT };
#define DEGREES 57.29577951308232
#define STILL(name, ...) fmi3Status name(__VA_ARGS__) { return fmi3OK; }
typedef struct { double v[COUNT]; } Motor;
static double rate(Motor *m) {
    return -(m->v[CONSTANT] * m->v[CONSTANT] / m->v[RESISTANCE] + m->v[DRAG]) / m->v[INERTIA];
}
static double push(Motor *m) { return m->v[CONSTANT] * 1e-3 * m->v[VOLTAGE] / m->v[RESISTANCE] / m->v[INERTIA]; }
static Motor *motor(void) {
    Motor *m = calloc(1, sizeof *m);
    double start[COUNT] = {0, 0, 0, 0, 2.0, 0.048, 1e-4, 1e-5};
    for (int k = 0; k < COUNT; k++) m->v[k] = start[k];
    return m;
}
const char *fmi3GetVersion(void) { return "3.0"; }
fmi3Instance fmi3InstantiateModelExchange(fmi3String n, fmi3String t, fmi3String r, fmi3Boolean v, fmi3Boolean l,
                                          fmi3InstanceEnvironment e, fmi3LogMessageCallback log) {
    return motor();
}
fmi3Instance fmi3InstantiateCoSimulation(fmi3String n, fmi3String t, fmi3String r, fmi3Boolean v, fmi3Boolean l,
                                         fmi3Boolean ev, fmi3Boolean early, const fmi3ValueReference q[], size_t nq,
                                         fmi3InstanceEnvironment e, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback u) {
    return motor();
}
void fmi3FreeInstance(fmi3Instance i) { free(i); }
STILL(fmi3SetDebugLogging, fmi3Instance i, fmi3Boolean b, size_t n, const fmi3String s[])
STILL(fmi3EnterInitializationMode, fmi3Instance i, fmi3Boolean d, fmi3Float64 t, fmi3Float64 s, fmi3Boolean b,
      fmi3Float64 e)
STILL(fmi3ExitInitializationMode, fmi3Instance i)
STILL(fmi3EnterEventMode, fmi3Instance i)
STILL(fmi3EnterContinuousTimeMode, fmi3Instance i)
STILL(fmi3EnterStepMode, fmi3Instance i)
STILL(fmi3Terminate, fmi3Instance i)
STILL(fmi3Reset, fmi3Instance i)
STILL(fmi3SetTime, fmi3Instance i, fmi3Float64 t)
STILL(fmi3GetEventIndicators, fmi3Instance i, fmi3Float64 z[], size_t n)
fmi3Status fmi3SetFloat64(fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3Float64 x[], size_t m) {
    for (size_t k = 0; k < n; k++) ((Motor *)i)->v[r[k]] = x[k];
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Float64 x[], size_t m) {
    Motor *one = i;
    one->v[RATE] = rate(one) * one->v[SPEED] + DEGREES * push(one);
    for (size_t k = 0; k < n; k++) x[k] = one->v[r[k]];
    return fmi3OK;
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance i, fmi3Boolean *more, fmi3Boolean *end, fmi3Boolean *nominals,
                                    fmi3Boolean *values, fmi3Boolean *next, fmi3Float64 *at) {
    *more = *end = *nominals = *values = *next = fmi3False;
    return fmi3OK;
}
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance i, fmi3Boolean b, fmi3Boolean *event, fmi3Boolean *end) {
    *event = *end = fmi3False;
    return fmi3OK;
}
fmi3Status fmi3SetContinuousStates(fmi3Instance i, const fmi3Float64 x[], size_t n) {
    ((Motor *)i)->v[SPEED] = x[0];
    return fmi3OK;
}
fmi3Status fmi3GetContinuousStates(fmi3Instance i, fmi3Float64 x[], size_t n) {
    x[0] = ((Motor *)i)->v[SPEED];
    return fmi3OK;
}
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance i, fmi3Float64 x[], size_t n) { x[0] = 1000.0; return fmi3OK; }
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance i, fmi3Float64 x[], size_t n) {
    x[0] = rate(i) * ((Motor *)i)->v[SPEED] + DEGREES * push(i);
    return fmi3OK;
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance i, size_t *n) { *n = 0; return fmi3OK; }
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance i, size_t *n) { *n = 1; return fmi3OK; }
fmi3Status fmi3DoStep(fmi3Instance i, fmi3Float64 t, fmi3Float64 h, fmi3Boolean b, fmi3Boolean *event,
                      fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last) {
    Motor *m = i;
    double kept = exp(rate(m) * h);
    m->v[SPEED] = kept * m->v[SPEED] + (kept - 1) / rate(m) * DEGREES * push(m);
    *event = *end = *early = fmi3False;
    *last = t + h;
    return fmi3OK;
}
"""
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="motor" instantiationToken="motor">
  <ModelExchange modelIdentifier="motor"/>
  <CoSimulation modelIdentifier="motor" canHandleVariableCommunicationStepSize="true"/>
  <UnitDefinitions><Unit name="mV"/><Unit name="deg/s"/></UnitDefinitions>
  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
    <Float64 name="voltage" valueReference="1" causality="input" unit="mV" start="0"/>
    <Float64 name="speed" valueReference="2" causality="output" unit="deg/s"/>
    <Float64 name="der(speed)" valueReference="3" causality="local" derivative="2"/>
    {parameters}
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="2"/>
    <ContinuousStateDerivative valueReference="3"/>
  </ModelStructure>
</fmiModelDescription>
"""
PARAMETER = (
    '<Float64 name="{name}" valueReference="{number}" causality="parameter" variability="tunable" start="{start}"/>'
)


def build(path: Path, compiler: str) -> Path:
    """Compile and zip the FMU for Linux on this processor; what the standard wants besides returns an error."""
    rows = [PARAMETER.format(name=n, number=k, start=start) for k, (n, start) in enumerate(PARAMETERS, start=4)]
    wanted = re.findall(r"\b(fmi3\w+)TYPE\b", (Path(headers()) / "fmi3FunctionTypes.h").read_text())
    absent = [name for name in dict.fromkeys(wanted) if not re.search(rf"\b{name}\(|\({name},", SOURCE)]
    with TemporaryDirectory() as folder:
        rest = "\n".join(f"fmi3Status {name}(void) {{ return fmi3Error; }}" for name in absent)
        (Path(folder) / "motor.c").write_text(SOURCE + rest)
        command = [compiler, "-shared", "-fPIC", "-O1", f"-I{headers()}", "motor.c", "-o", "motor.so", "-lm"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", DESCRIPTION.format(parameters="\n    ".join(rows)))
            archive.write(Path(folder) / "motor.so", "binaries/x86_64-linux/motor.so")
    return path
