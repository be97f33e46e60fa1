# SPDX-License-Identifier: BSD-2-Clause
"""Text of system.c, the C file of a fused system: its tables, and its macro step as code without
loops. A part is a component of the system.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from fused_layout import CAUSALITY, INPUT, KINDS, OUTPUT, RULES, Part, Row, Whole


def number(value: float) -> str:
    """Return a value as a C literal that gives the same double on every platform."""
    return float(value).hex()


def runs(pairs: Iterable[tuple[int, int]]) -> Iterator[tuple[int, int, int]]:
    """Yield copies (place to copy from, place to copy to, count) that replace the copies `pairs`
    (from, to) of single doubles: neighbouring doubles are copied together.
    """
    last: list[int] = []
    for start, to in sorted(pairs, key=lambda pair: pair[1]):
        if last and (start, to) == (last[0] + last[2], last[1] + last[2]):
            last[2] += 1
            continue
        if last:
            yield last[0], last[1], last[2]
        last = [start, to, 1]
    if last:
        yield last[0], last[1], last[2]


Transfer = tuple[int, int, int, float, float]
"""Copy of consecutive doubles in the memory of the system: place to copy from, place to copy to,
count, factor, offset. A place is the index of a double; a copied value is factor value + offset.
"""


def driven(whole: Whole, part: Part) -> list[Transfer]:
    """Return the copies that write the connected inputs of a part from the outputs that drive these
    inputs.
    """
    places = {
        name: part.place(row, k)
        for row in part.model.rows
        if row.causality == INPUT
        for k, name in enumerate(row.elements())
    }
    plain, changed = [], []
    for name, (source, output, factor, offset) in part.driven.items():
        pair = whole.parts[source].published[output], places[name]
        if (factor, offset) == (1.0, 0.0):
            plain.append(pair)
        else:
            changed.append((*pair, 1, factor, offset))
    return [(*run, 1.0, 0.0) for run in runs(plain)] + changed


def late(part: Part) -> list[Transfer]:
    """Return the copies that publish the outputs of a part if the schedule publishes them not in
    the step of the part but in a later action; otherwise [].
    """
    if not part.late:
        return []
    pairs = [
        (part.place(row, k), part.published[name])
        for row in part.model.rows
        if row.causality == OUTPUT
        for k, name in enumerate(row.elements())
    ]
    return [(*run, 1.0, 0.0) for run in runs(pairs)]


def system_c(spec: dict[str, Any], whole: Whole, digest: str) -> str:
    """Return the text of system.c; spec: content of SYSTEM.json, see fuse.py; digest: hash of
    connections and schedule.
    """
    symbols = dict.fromkeys(part.model.symbol for part in whole.parts)
    work = max(part.model.size + part.model.scratch for part in whole.parts)
    lines = [
        f"/* system.c - {_comment(spec['text'])}",
        " *",
        f" * {len(whole.parts)} components in one model; names of variables begin with the name of",
        " * the component. A macro step calls the components in the order of the schedule:",
        *(f" *     {part.name}: {part.model.symbol}" for part in whole.parts),
        " *",
        " * Written by fuse.py; fused.h explains it. */",
        "/* SPDX-License-Identifier: BSD-2-Clause */",
        '#include "fused.h"',
        "",
        *(f"extern const ModelInterface {symbol};" for symbol in symbols),
        "",
        "/* parameters, inputs, states, outputs, time, step */",
        "typedef void Step(const void *, const void *, void *, void *, double, double);",
        *(f"extern Step {symbol}_step;" for symbol in symbols),
        "",
        f"enum {{ PARTS = {len(whole.parts)}, SIZE = {whole.size}, CLOCK = {len(whole.front)}, "
        f"WORK = {work} }};",
        "",
        "static const double start[SIZE] = {",
        *(f"    {number(value)}," for value in whole.front),
        "};",
        "",
        *_table("variables", whole.rows),
        *_table("checked", whole.checked),
    ]
    for i, part in enumerate(whole.parts):
        lines += _copies(f"driven_{i}", driven(whole, part))
        lines += _copies(f"late_{i}", late(part))
    lines += ["static const Part parts[PARTS] = {"]
    for i, part in enumerate(whole.parts):
        tables = (("driven", driven(whole, part)), ("late", late(part)))
        shown = ", ".join(f"{{{f'{n}_{i}' if t else 'NULL'}, {len(t)}}}" for n, t in tables)
        places = f"{part.head}, {part.tail}"
        lines.append(f'    {{"{part.name}.", &{part.model.symbol}, {places}, {shown}}},')
    lines += [
        "};",
        "",
        "static void check_system(void *model, Problems *problems)",
        "{",
        "    double *m = model;",
        "    for (size_t i = 0; i < PARTS; i++) check_part(&parts[i], m, m + SIZE, problems);",
        "}",
        "",
        "static void initialize_system(void *model, double t)",
        "{",
        "    bool stale[PARTS];",
        "    double *m = model;",
        "    m[CLOCK] = t;",
        "    m[CLOCK + 1] = 0;",
        *(f"    m[{place}] = t; /* {whole.parts[i].name} */" for i, place in whole.times.items()),
        "    m[CLOCK + 2] = !initialize_parts(parts, PARTS, stale, m, m + SIZE, t);",
        "}",
        "",
        "static double macro_step(const void *model) { return *(const double *)model; }",
        "",
        "static void step_system(void *model, double t, double h)",
        "{",
        "    double *m = model;",
        *_step(spec["plan"], whole),
        "}",
        "",
        "const ModelInterface FMU_MODEL_SYMBOL = {",
        f'    "{spec["name"]}",',
        f"    {_literal(spec['text'])},",
        "    SIZE * sizeof(double),",
        "    CLOCK * sizeof(double),",
        "    SIZE - CLOCK,",
        "    WORK * sizeof(double),",
        "    start,",
        "    variables,",
        "    COUNT(variables),",
        "    check_system,",
        "    initialize_system,",
        "    step_system,",
        "    macro_step,",
        f'    "{digest}",',
        *(("    checked,", "    COUNT(checked)};") if whole.checked else ("    NULL,", "    0};")),
        "",
    ]
    return "\n".join(lines)


def _comment(text: str) -> str:
    return text.replace("*/", "* /")


def _literal(text: str) -> str:
    escaped = text.encode("unicode_escape").decode() if not text.isprintable() else text
    return '"' + escaped.replace("\\", "\\\\").replace('"', '\\"').replace("?", "\\?") + '"'


def _table(name: str, rows: list[Row]) -> Iterator[str]:
    if not rows:
        return
    yield f"static const Variable {name}[] = {{"
    for r in rows:
        names = _literal(r.names) if r.names else "NULL"
        yield (
            f'    {{{CAUSALITY[r.causality]}, "{r.name}", {r.first} * sizeof(double), {r.size}, '
            f'{r.columns}, "{r.unit}", {_literal(r.text)}, {RULES[r.rule]}, {KINDS[r.kind]}, '
            f"{names}}},"
        )
    yield "};"
    yield ""


def _copies(name: str, copies: list[Transfer]) -> Iterator[str]:
    if not copies:
        return
    yield f"static const Copy {name}[] = {{"
    for start, to, count, factor, offset in copies:
        plain = "true" if (factor, offset) == (1.0, 0.0) else "false"
        yield f"    {{{start}, {to}, {count}, {number(factor)}, {number(offset)}, {plain}}},"
    yield "};"
    yield ""


def _step(plan: list[Any], whole: Whole) -> Iterator[str]:
    """Yield the C lines of a macro step: the actions of the schedule `plan` in their order."""
    slow = [action for action in plan if action[2] > 1]
    if slow:
        yield "    const long long k = (long long)m[CLOCK + 1];"
    if whole.times:
        yield "    const double now = m[CLOCK] + m[CLOCK + 1] * h;"
    for verb, i, every, phase in plan:
        body = list(_action(verb, i, every, whole))
        if body and every > 1:
            yield f"    if (k % {every} == {phase}) {{"
            yield from (f"    {line}" for line in body)
            yield "    }"
        else:
            yield from body
    yield "    m[CLOCK + 1] += 1;"


def _action(verb: str, i: int, every: int, whole: Whole) -> Iterator[str]:
    part = whole.parts[i]
    if verb == "set":
        yield f"    /* {part.name} */"
        yield from map(_copy, driven(whole, part))
    elif verb == "step" and every == 1:
        yield f"    {part.model.symbol}_step({_pieces(part)}, t, h);"
    elif verb == "step":
        time = f"m[{whole.times[i]}]"
        yield f"    {part.model.symbol}_step({_pieces(part)}, {time}, {every} * h);"
        yield f"    {time} = now + {every} * h;"
    else:
        yield from map(_copy, late(part))


def _pieces(part: Part) -> str:
    """Return the C arguments of a step of a part: pointers to its parameters, inputs, states and
    outputs.
    """
    model = part.model
    outputs = part.tail + model.outputs - model.states
    places = (part.head, part.head + model.inputs, part.tail, outputs)
    return ", ".join(f"m + {place}" for place in places)


def _copy(copy: Transfer) -> str:
    start, to, count, factor, offset = copy
    if (factor, offset) != (1.0, 0.0):
        return f"    m[{to}] = {number(factor)} * m[{start}] + {number(offset)};"
    if count == 1:
        return f"    m[{to}] = m[{start}];"
    return f"    memcpy(m + {to}, m + {start}, {count} * sizeof *m);"
