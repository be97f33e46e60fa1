# SPDX-License-Identifier: BSD-2-Clause
"""Small FMUs of FMI 3.0 from a few lines of C, built with gcc and FMPy's headers; they share no
code with the project, and have what its FMUs do not: all types, arrays sized by structural
parameters, clocks, steps that end early.

In `step` variables go by their names; arrays are C arrays.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import fmpy
from fmpy import platform_tuple, sharedLibraryExtension

from tests.compiled import compiled

HEADERS = Path(fmpy.__file__).parent / "c-code"
NUMBERS = ("Float64", "Float32", *(f"{u}Int{n}" for u in ("", "U") for n in (8, 16, 32, 64)))


class Var(NamedTuple):
    """One variable; size: of an array, 0 of a scalar; by: structural parameter with its size."""

    name: str
    tag: str
    causality: str
    start: str = "0"
    size: int = 0
    by: str = ""
    more: str = ""


@dataclass(frozen=True)
class Model:
    """Source of an FMU."""

    name: str
    variables: tuple[Var, ...]
    step: str = ""
    structure: str = ""
    interface: str = "CoSimulation"
    head: str = field(default='canGetAndSetFMUState="true"')


def _xml(model: Model) -> str:
    references = {v.name: i + 1 for i, v in enumerate(model.variables)}
    lines = []
    for v in model.variables:
        start = v.causality != "output" and v.tag not in ("Clock", "Binary", "String")
        text = f' start="{v.start}"' if start else ""
        inside = (
            f'<Start value="{v.start}"/>' if v.tag == "String" and v.causality != "output" else ""
        )
        if v.size:
            what = f'valueReference="{references[v.by]}"' if v.by else f'start="{v.size}"'
            inside += f"<Dimension {what}/>"
        kind = ' declaredType="Colour"' if v.tag == "Enumeration" else ""
        kind += ' intervalVariability="triggered"' if v.tag == "Clock" else ""
        fixed = (
            ' variability="fixed"' if v.causality in ("parameter", "structuralParameter") else ""
        )
        lines.append(
            f'<{v.tag} name="{v.name}" valueReference="{references[v.name]}" '
            f'causality="{v.causality}"{fixed}{kind}{text}{v.more}>{inside}</{v.tag}>'
        )
    outputs = [r for name, r in references.items() for v in model.variables
               if v.name == name and v.causality == "output"]  # fmt: skip
    structure = "".join(f'<Output valueReference="{r}"/>' for r in outputs)
    structure += "".join(f'<InitialUnknown valueReference="{r}"/>' for r in outputs)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="{model.name}" instantiationToken="{{1}}">
<{model.interface} modelIdentifier="{model.name}" {model.head}/>
<TypeDefinitions><EnumerationType name="Colour"><Item name="red" value="1"/>
<Item name="blue" value="7"/></EnumerationType></TypeDefinitions>
<ModelVariables>
<Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
{chr(10).join(lines)}
</ModelVariables>
<ModelStructure>{structure}</ModelStructure>
</fmiModelDescription>
"""


def _c(model: Model) -> str:
    plain = [v for v in model.variables if v.tag not in ("Clock", "Binary", "String")]
    kinds = {v.name: "Int64" if v.tag == "Enumeration" else v.tag for v in plain}
    names = "".join(f"\n#define {v.name} ({'' if v.size else '*'}self->m_{v.name})" for v in plain)
    members = "".join(f"fmi3{kinds[v.name]} m_{v.name}[{max(v.size, 1)}];" for v in plain)
    functions = []
    for kind in (*NUMBERS, "Boolean"):
        for verb, const in (("Get", ""), ("Set", "const ")):
            cases = []
            for i, v in enumerate(model.variables):
                if kinds.get(v.name) == kind:
                    a, b = f"c->m_{v.name}", "value + k"
                    to, of = (b, a) if verb == "Get" else (a, b)
                    cases.append(
                        f"case {i + 1}: memcpy({to}, {of}, sizeof c->m_{v.name}); "
                        f"k += {max(v.size, 1)}; break;"
                    )
            functions.append(
                f"fmi3Status fmi3{verb}{kind}(fmi3Instance i, const fmi3ValueReference r[], "
                f"size_t n, {const}fmi3{kind} value[], size_t m) {{ C *c = i; size_t k = 0; "
                "(void)c; (void)value; for (size_t j = 0; j < n; j++) "
                f"switch (r[j]) {{ {' '.join(cases)} "
                "default: return fmi3Error; } return k == m ? fmi3OK : fmi3Error; }"
            )
    starts = "".join(
        f"c->m_{v.name}[{i}] = {word};"
        for v in plain if v.causality != "output"
        for i, word in enumerate(v.start.split() if v.size else [v.start])
    )  # fmt: skip
    return f"""#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "fmi3Functions.h"
typedef struct {{ {members} fmi3InstanceEnvironment e; fmi3LogMessageCallback log;
  char text[99]; }} C;
{chr(10).join(functions)}
static void reset(C *c) {{ {starts} }}
fmi3Instance fmi3InstantiateCoSimulation(fmi3String n, fmi3String token, fmi3String r,
  fmi3Boolean v, fmi3Boolean l, fmi3Boolean event, fmi3Boolean early,
  const fmi3ValueReference q[], size_t m,
  fmi3InstanceEnvironment e, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback u)
{{ (void)n, (void)r, (void)v, (void)l, (void)q, (void)m, (void)u;
  if (strcmp(token, "{{1}}") || event || early) return NULL;
  C *c = calloc(1, sizeof *c); c->e = e; c->log = log; reset(c); return c; }}
void fmi3FreeInstance(fmi3Instance i) {{ free(i); }}
fmi3Status fmi3SetString(fmi3Instance i, const fmi3ValueReference r[], size_t n,
  const fmi3String v[], size_t m)
{{ C *c = i; (void)r, (void)n, (void)m; strncpy(c->text, v[0], 98); return fmi3OK; }}
fmi3Status fmi3EnterInitializationMode(fmi3Instance i, fmi3Boolean a, fmi3Float64 b, fmi3Float64 d,
  fmi3Boolean e, fmi3Float64 f)
{{ (void)i, (void)a, (void)b, (void)d, (void)e, (void)f; return fmi3OK; }}
fmi3Status fmi3ExitInitializationMode(fmi3Instance i) {{ (void)i; return fmi3OK; }}
fmi3Status fmi3Terminate(fmi3Instance i) {{ (void)i; return fmi3OK; }}
fmi3Status fmi3Reset(fmi3Instance i) {{ C *c = i, old = *c; memset(c, 0, sizeof *c);
  c->e = old.e; c->log = old.log; reset(c); return fmi3OK; }}
fmi3Status fmi3GetFMUState(fmi3Instance i, fmi3FMUState *s)
{{ if (!*s) *s = malloc(sizeof(C)); memcpy(*s, i, sizeof(C)); return fmi3OK; }}
fmi3Status fmi3SetFMUState(fmi3Instance i, fmi3FMUState s)
{{ memcpy(i, s, sizeof(C)); return fmi3OK; }}
fmi3Status fmi3FreeFMUState(fmi3Instance i, fmi3FMUState *s)
{{ (void)i; free(*s); *s = NULL; return fmi3OK; }}
static fmi3Status fail(C *c, const char *why)
{{ c->log(c->e, fmi3Error, "logStatusError", why); return fmi3Error; }}
{names}
fmi3Status fmi3DoStep(fmi3Instance i, fmi3Float64 t, fmi3Float64 h, fmi3Boolean p,
  fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{{ C *self = i; (void)p; (void)fail; *event = *terminate = *early = fmi3False; *last = t + h;
  {model.step}
  return fmi3OK; }}
"""


def build(model: Model, folder: Path) -> Path:
    """The FMU in a folder."""
    source, library = folder / f"{model.name}.c", folder / f"{model.name}{sharedLibraryExtension}"
    source.write_text(_c(model), encoding="utf-8")
    compiled(source, library, "-O1", f"-I{HEADERS}")
    path = folder / f"{model.name}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", _xml(model))
        archive.write(library, f"binaries/{platform_tuple}/{model.name}{sharedLibraryExtension}")
    return path
