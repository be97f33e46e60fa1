# SPDX-License-Identifier: BSD-2-Clause
"""Small FMUs from a few lines of C, built with gcc and FMPy's headers; they share no code with the
project.

A model is a list of variables and pieces of C in which they go by their own names (`x[1]` is x_1,
`a.b` is a_b): `outputs` computes the outputs from inputs, parameters and states, in initialization
and after every step; `step` advances over h from time t; `check` validates the parameters at the
end of initialization. All may `return fail(status, text)`.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import fmpy

from tests.compiled import compiled

HEADERS = Path(fmpy.__file__).parent / "c-code"


class Var(NamedTuple):
    """One scalar variable of a third-party FMU."""

    name: str
    causality: str
    start: float = 0.0
    unit: str | None = "1"
    type: str = "Real"
    optional: bool = False


@dataclass(frozen=True)
class Model:
    """Source of a third-party FMU."""

    name: str
    variables: Sequence[Var]
    outputs: str = ""
    step: str = ""
    check: str = ""
    can_save: bool = True
    reset: str = "c->latched = 0; @START@ return fmi2OK;"
    units: Sequence[str] = field(default=("1", "m", "s"))


def u(name: str, unit: str | None = "1", type: str = "Real", start: float = 0.0) -> Var:
    return Var(name, "input", start, unit, type)


def y(name: str, unit: str | None = "1", type: str = "Real") -> Var:
    return Var(name, "output", 0.0, unit, type)


def p(name: str, start: float = 0.0, unit: str | None = "1", type: str = "Real") -> Var:
    return Var(name, "parameter", start, unit, type)


def x(name: str) -> Var:
    return Var(name, "local")


GAIN = Model("gain", [u("u"), y("y"), p("k", 2.0)], outputs="y = k * u;")
INTEGRATOR = Model("integrator", [u("u"), y("y"), p("y_0"), x("z")], "y = z + y_0;", "z += h * u;")
COUNTER = Model(
    "counter",
    [y("n"), y("t_last", "s"), y("h_last", "s"), p("n_0"), x("count"), x("t_"), x("h_")],
    outputs="n = n_0 + count; t_last = t_; h_last = h_;",
    step="count += 1; t_ = t; h_ = h;",
)
VECTOR = Model(
    "vector",
    [
        *(u(f"v[{i}]", "m") for i in (1, 2, 3)),
        *(y(f"w[{i}]", "m") for i in (1, 2, 3)),
        *(p(f"J[{i},{j}]") for i in (1, 2) for j in (1, 2)),
        p("M.bias", 1.0),
    ],
    outputs="w_1 = J_1_1 * v_1 + J_1_2 * v_2; w_2 = J_2_1 * v_1 + J_2_2 * v_2; w_3 = M_bias * v_3;",
)
LADDER = Model(
    "ladder",
    [*(u(f"v[{i}]") for i in (1, 2, 3)), *(y(f"w[{i}]") for i in (1, 2, 3))],
    outputs="w_1 = v_1 + 1; w_2 = v_2 + 1; w_3 = v_3 + 1;",
)
SOURCE = Model(
    "source",
    [*(y(f"v[{i}]", "m") for i in (1, 2, 3)), x("n")],
    "v_1 = n; v_2 = 10 * n; v_3 = 100 * n;",
    "n += 1;",
)
FAILING = Model(
    "failing",
    [y("y"), p("t_fail", 3.0, "s"), p("status", 3.0), x("t_")],
    outputs="y = t_;",
    step="if (t >= t_fail - 1e-9)"
    ' return fail((int)status, "burnt through\\nafter too much heat"); t_ = t;',
)
SILENT = Model("silent", [y("y")], step="return fmi2Error;")
NOT_A_NUMBER = Model(
    "not_a_number",
    [y("y"), p("t_nan", 3.0, "s"), x("t_")],
    "y = t_ >= t_nan ? NAN : t_;",
    "t_ = t;",
)
PLUS_ONE = Model("plus_one", [u("u"), y("y")], outputs="y = u + 1;")
PICKY = Model(
    "picky",
    [y("y"), p("mass", 1.0)],
    "y = mass;",
    check='if (!(mass > 0)) return fail(3, "mass must be > 0");',
)
NO_STATE = Model("no_state", [u("u"), y("y"), x("z")], "y = z;", "z += h * u;", can_save=False)
MIXED = Model(
    "mixed",
    [
        u("i", None, "Integer"),
        u("b", None, "Boolean"),
        u("r"),
        y("r_out"),
        y("n", None, "Integer"),
        y("odd", None, "Boolean"),
        p("offset", 1, None, "Integer"),
        p("flip", 0, None, "Boolean"),
        Var("label", "parameter", 0, None, "String"),
        x("z"),
    ],
    outputs="n = (int)z + offset; odd = (n % 2 != 0) != flip; r_out = 1000 * r + 10 * i + b;",
    step="z += 1;",
)
SLOW = Model(
    "slow",
    [y("n"), x("z")],
    "n = z;",
    'if (!z) fclose(fopen("stepping", "w")); z += 1; usleep(2000);',
)
KILOMETRES = Model(
    "kilometres", [u("u", "km"), y("y", "km"), p("k", 1.0, "km")], "y = u + k;", units=("1", "km")
)
CELSIUS = Model("celsius", [u("u", "degC"), y("y", "degC")], "y = u;", units=("degC",))
KELVIN = Model("kelvin", [u("u", "K"), y("y", "K")], "y = u;", units=("K",))
MODED = Model("moded", [y("y"), p("mode", 1, None, "Enumeration")], "y = 10 * mode;")
CRASHING = Model(
    "crashing", [y("y"), x("z")], "y = z;", "z += 1; if (z > 2) *(volatile int *)0 = 1;"
)
WARNING = Model("warning", [y("y")], step='say(c, 1, "getting hot"); return fmi2Warning;')

MODELS = (
    GAIN, INTEGRATOR, COUNTER, VECTOR, SOURCE, FAILING, SILENT, LADDER, NOT_A_NUMBER, PLUS_ONE,
    PICKY, NO_STATE, MIXED, SLOW, WARNING, KILOMETRES, CELSIUS, KELVIN, MODED, CRASHING,
)  # fmt: skip

SOURCE_TEXT = r"""
#define _DEFAULT_SOURCE
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "fmi2Functions.h"

typedef struct {
    double real[@COUNT@];
    int integer[@COUNT@];
    char name[100];
    const fmi2CallbackFunctions *call;
    int latched; /* outputs stand since the last step; before the first one they follow the inputs
    */
} Instance;

static void say(Instance *c, int status, const char *text)
{
    c->call->logger(c->call->componentEnvironment, c->name, (fmi2Status)status, "logStatusError",
    "%s", text);
}
#define fail(status, text) (say(c, status, text), (fmi2Status)(status))
@NAMES@
static fmi2Status outputs(Instance *c) { (void)c; @OUTPUTS@ return fmi2OK; }
static fmi2Status step(Instance *c, double t, double h) { (void)c; (void)t; (void)h; @STEP@ return
fmi2OK; } static fmi2Status check(Instance *c) { (void)c; @CHECK@ return fmi2OK; }
@NO_NAMES@
#define NOTHING { return fmi2OK; }
#define ERROR { return fmi2Error; }
const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String k[])
NOTHING fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String
place,
                              const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean
                              logging)
{
    Instance *c = calloc(1, sizeof *c);
    strncpy(c->name, name, sizeof c->name - 1);
    c->call = call;
    @START@
    return c;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real
start,
                               fmi2Boolean stops, fmi2Real stop) NOTHING
fmi2Status fmi2EnterInitializationMode(fmi2Component c) NOTHING
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return check(c); }
fmi2Status fmi2Terminate(fmi2Component c) NOTHING
fmi2Status fmi2Reset(fmi2Component m)
{
    Instance *c = m;
    @RESET@
}
fmi2Status fmi2GetReal(fmi2Component m, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Instance *c = m;
    if (!c->latched) outputs(c);
    for (size_t i = 0; i < n; i++) value[i] = c->real[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2GetInteger(fmi2Component m, const fmi2ValueReference vr[], size_t n, fmi2Integer
value[]) {
    Instance *c = m;
    if (!c->latched) outputs(c);
    for (size_t i = 0; i < n; i++) value[i] = c->integer[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean
value[]) {
    return fmi2GetInteger(c, vr, n, value);
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String
value[]) ERROR fmi2Status fmi2SetReal(fmi2Component m, const fmi2ValueReference vr[], size_t n,
const fmi2Real value[]) {
    Instance *c = m;
    for (size_t i = 0; i < n; i++) c->real[vr[i]] = value[i];
    return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component m, const fmi2ValueReference vr[], size_t n, const
fmi2Integer value[]) {
    Instance *c = m;
    for (size_t i = 0; i < n; i++) c->integer[vr[i]] = value[i];
    return fmi2OK;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const
fmi2Boolean value[]) {
    return fmi2SetInteger(c, vr, n, value);
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String
value[]) NOTHING fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    *state = malloc(sizeof(Instance));
    memcpy(*state, c, sizeof(Instance));
    return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    memcpy(c, state, sizeof(Instance));
    return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    free(*state);
    *state = NULL;
    return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate s, size_t *n) ERROR
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n) ERROR
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
ERROR fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference a[], size_t
na,
    const fmi2ValueReference b[], size_t nb, const fmi2Real d[], fmi2Real e[]) ERROR
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
    const fmi2Integer o[], const fmi2Real v[]) ERROR
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
    const fmi2Integer o[], fmi2Real v[]) ERROR
fmi2Status fmi2DoStep(fmi2Component m, fmi2Real t, fmi2Real h, fmi2Boolean no_rollback)
{
    Instance *c = m;
    fmi2Status status = step(c, t, h);
    c->latched = 1;
    if (status > fmi2Warning) return status;
    fmi2Status evaluated = outputs(c);
    return evaluated > status ? evaluated : status;
}
fmi2Status fmi2CancelStep(fmi2Component c) ERROR
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind k, fmi2Status *v) ERROR
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind k, fmi2Real *v) ERROR
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind k, fmi2Integer *v) ERROR
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind k, fmi2Boolean *v) ERROR
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind k, fmi2String *v) ERROR
"""


def build(model: Model, folder: Path, text: str | None = None) -> Path:
    """Compile and pack a model; returns the .fmu. text: its C source, if it is not as usual."""
    source, library = folder / f"{model.name}.c", folder / f"{model.name}.so"
    source.write_text(text or source_text(model))
    compiled(source, library, "-O1", "-w", f"-I{HEADERS}")
    fmu = folder / f"{model.name}.fmu"
    with zipfile.ZipFile(fmu, "w") as archive:
        archive.writestr("modelDescription.xml", description(model))
        archive.write(
            library, f"binaries/{fmpy.platform}/{model.name}{fmpy.sharedLibraryExtension}"
        )
    return fmu


def source_text(model: Model) -> str:
    """C source of a model."""
    names = {
        re.sub(r"\W+", "_", v.name).strip("_") + "_" * v.name.endswith("_"): i
        for i, v in enumerate(model.variables)
    }
    array = [
        "integer" if v.type in ("Integer", "Boolean", "Enumeration") else "real"
        for v in model.variables
    ]
    parts = {
        "RESET": model.reset,
        "COUNT": str(len(model.variables) + 1),
        "NAMES": "\n".join(f"#define {name} c->{array[i]}[{i}]" for name, i in names.items()),
        "NO_NAMES": "\n".join(f"#undef {name}" for name in names),
        "START": " ".join(
            f"c->{array[i]}[{i}] = {v.start};" for i, v in enumerate(model.variables)
        ),
        "OUTPUTS": model.outputs,
        "STEP": model.step,
        "CHECK": model.check,
    }
    text = SOURCE_TEXT
    for key, value in parts.items():
        text = text.replace(f"@{key}@", value)
    return text


def description(model: Model) -> str:
    """Write modelDescription.xml of a model."""
    variables = "".join(_variable(i, v) for i, v in enumerate(model.variables))
    outputs = [i + 1 for i, v in enumerate(model.variables) if v.causality == "output"]
    unknowns = "".join(f'<Unknown index="{i}" dependencies=""/>' for i in outputs)
    units = "".join(f'<Unit name="{name}"><BaseUnit {BASE[name]}/></Unit>' for name in model.units)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{model.name}" guid="{model.name}"
                     variableNamingConvention="structured">
  <CoSimulation modelIdentifier="{model.name}" canHandleVariableCommunicationStepSize="true"
                canGetAndSetFMUstate="{str(model.can_save).lower()}"/>
  <UnitDefinitions>{units}</UnitDefinitions>
  {TYPE_DEFINITIONS}
  <ModelVariables>{variables}</ModelVariables>
  <ModelStructure><Outputs>{unknowns}</Outputs>
  <InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""


BASE = {
    "1": "", "m": 'm="1"', "s": 's="1"', "km": 'm="1" factor="1000"', "K": 'K="1"',
    "degC": 'K="1" offset="273.15"', "m/s": 'm="1" s="-1"', "rad/s2": 'rad="1" s="-2"',
    "N": 'kg="1" m="1" s="-2"', "N.m": 'kg="1" m="2" s="-2"',
    "N/m": 'kg="1" s="-2"', "N.s/m": 'kg="1" s="-1"',
}  # fmt: skip
TYPE_DEFINITIONS = """<TypeDefinitions><SimpleType name="Mode"><Enumeration>
    <Item name="off" value="1"/><Item name="hold" value="4"/><Item name="go" value="7"/>
  </Enumeration></SimpleType></TypeDefinitions>"""
MARK = '<Annotations><Tool name="servicing-fmus"><OptionalInput/></Tool></Annotations>'
VARIABILITY = {"parameter": "fixed", "local": "continuous"}


def _variable(i: int, v: Var) -> str:
    variability = VARIABILITY.get(v.causality, "continuous" if v.type == "Real" else "discrete")
    number = int(v.start)
    texts = {
        "Boolean": str(bool(v.start)).lower(),
        "Integer": number,
        "Enumeration": number,
        "String": "",
    }
    start = texts.get(v.type, v.start)
    starts = f' start="{start}"' if v.causality in ("input", "parameter") else ""
    kind = ' declaredType="Mode"' if v.type == "Enumeration" else ""
    unit = f" unit={quoteattr(v.unit)}" if v.unit and v.type == "Real" else ""
    head = (
        f'name={quoteattr(v.name)} valueReference="{i}" causality="{v.causality}"'
        f' variability="{variability}"'
    )
    notes = MARK if v.optional else ""
    return f"<ScalarVariable {head}><{v.type}{kind}{unit}{starts}/>{notes}</ScalarVariable>"
