# SPDX-License-Identifier: BSD-2-Clause
"""Run flight software on random inputs and parameters with libFuzzer and sanitizers.

    python .ci/fuzz.py FOLDER FILE [--seconds N] [COMPONENT...]                       (make fuzz)

A run simulates a component for up to 32 steps and takes its values from the bytes that libFuzzer
generates: parameters at their start values or 0.5 to 2.5 times these (switches: 0 or 1; whole
numbers: start values), inputs anywhere in the range that the component's table of variables allows.
The address and undefined behaviour sanitizers end a run at an index outside an array, an overflow
of an integer, a conversion of a number that does not fit, or a read outside of an object; such an
end is a finding. The corpus (the bytes from which libFuzzer generates further ones) remains in
FOLDER and grows with later runs. FILE receives a line of JSON per component. Without COMPONENT all
flight software is run.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import evidence
import proofs

from fmus.core.build import flight_rules

SEED = 43
SECONDS = 10
SANITIZERS = "fuzzer,address,undefined,float-cast-overflow"
PROGRAM = """#include <stdlib.h>
#define reject reject_with_text
#include "fmu.h"
#undef reject
static void reject(Problems *all, const char *name, double value, const char *rule)
{{
    (void)name, (void)value, (void)rule;
    all->count = 1;
}}
#include "{source}"

static Model m;
static unsigned long steps;
static const uint8_t *at, *end;
{scratch}
static unsigned byte(void) {{ return at < end ? *at++ : 0; }}
static double any(int negative)
{{
    union {{ uint64_t bits; double value; }} x = {{0}};
    for (int i = 0; i < 8; i++) x.bits = x.bits << 8 | byte();
    if (!isfinite(x.value)) x.value = 1;
    return negative || x.value > 0 ? x.value : -x.value;
}}
static double near(double value) {{ return value * (0.5 + byte() / 128.0); }}
static void set_inputs(void)
{{
    double *x = (double *)&m;
{inputs}
    (void)x;
}}
static void print_steps(void) {{ fprintf(stderr, "steps: %lu\\n", steps); }}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{{
    static int registered;
    if (!registered) registered = !atexit(print_steps);
    at = data, end = data + size;
    Problems problems = {{{{0}}, 0, ""}};
    double *x = (double *)&m, t = 0, h = 0.1;
    m = start;
    if (byte() & 1) {{
{parameters}
    }}
    check(&m.p, &problems);
    if (problems.count) return 0;
    set_inputs();
    initialize(&m.p, &m.u, &m.x, &m.y, t{work});
    for (int k = 0; k < 32 && at < end; k++, t += h, steps++) {{
        set_inputs();
        step(&m.p, &m.u, &m.x, &m.y, t, h);
    }}
    (void)x;
    return 0;
}}
"""


def input_lines(model: proofs.Model) -> Iterator[str]:
    """Yield the C statements that set every element of the inputs from random bytes."""
    for row in model.rows:
        rule = proofs.RULES[row.rule]
        value = f"any({int(rule == 'ANY_VALUE')})"
        if rule in ("SWITCH_VALUE", "ALARM_VALUE"):
            value = "byte() & 1"
        if row.causality == proofs.INPUT:
            yield from (f"    x[{row.first + i}] = {value};" for i in range(row.size))


def parameter_lines(model: proofs.Model) -> Iterator[str]:
    """Yield the C statements that change parameters, except parameters that are whole numbers."""
    for row in model.rows:
        if row.causality != proofs.PARAMETER or row.name in proofs.WHOLE:
            continue
        switch = proofs.RULES[row.rule] == "SWITCH_VALUE"
        for i in range(row.first, row.first + row.size):
            yield f"        x[{i}] = {'byte() & 1' if switch else f'near(x[{i}])'};"


def program(source: Path, model: proofs.Model) -> str:
    """Return the C program that libFuzzer runs."""
    work = re.search(r"FMU_MODEL_WITH\((\w+),", source.read_text(encoding="utf-8"))
    return PROGRAM.format(
        source=source,
        scratch=f"static {work[1]} scratch;" if work else "",
        work=", &scratch" if work else "",
        inputs="\n".join(input_lines(model)),
        parameters="\n".join(parameter_lines(model)),
    )


def fuzz(source: Path, model: proofs.Model, folder: Path, seconds: int) -> dict[str, object]:
    """Run a component under libFuzzer for some seconds and return its line of FILE: among others,
    the number of steps, the number of control-flow edges that were reached, and the number of
    findings (0 or 1). The corpus and the bytes that caused a finding remain in folder/COMPONENT.
    """
    place = folder / source.stem
    (place / "corpus").mkdir(parents=True, exist_ok=True)
    file, target = place / f"{source.stem}_fuzz.c", place / "fuzz"
    file.write_text(program(source, model), encoding="utf-8")
    options = ["-O1", "-g", "-w", "-std=c99", "-ffp-contract=off", f"-fsanitize={SANITIZERS}"]
    options += ["-fno-sanitize-recover=all", *flight_rules.INCLUDE]
    subprocess.run(["clang-19", *options, file, "-o", target, "-lm"], check=True)
    options = [f"-max_total_time={seconds}", f"-seed={SEED}", "-max_len=8192", "-len_control=0"]
    options += ["-print_final_stats=1", "-timeout=300", f"-artifact_prefix={place}/"]
    done = subprocess.run(
        [target, *options, place / "corpus"], capture_output=True, text=True, check=False
    )
    (place / "log.txt").write_text(done.stderr, encoding="utf-8")
    edges = re.findall(r"cov: (\d+)", done.stderr)
    steps = re.search(r"steps: (\d+)", done.stderr)
    return {
        "component": source.stem, "sources": evidence.hash_of(source), "seconds": seconds,
        "steps": int(steps[1]) if steps else 0, "edges": int(edges[-1]) if edges else 0,
        "findings": int(done.returncode != 0),
    }  # fmt: skip


def main() -> None:
    """Run the command line, see the docstring of the module."""
    parser = argparse.ArgumentParser()
    for name in ("folder", "file"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--seconds", type=int, default=SECONDS, help="time per component [s]")
    parser.add_argument("components", nargs="*")
    a = parser.parse_args()
    known, models = evidence.lines_of(a.file), proofs.models()
    for source in flight_rules.sources():
        if a.components and source.stem not in a.components:
            continue
        row = fuzz(source, models[source.stem], a.folder, a.seconds)
        known[source.stem] = [row]
        print(json.dumps(row), flush=True)
        lines = (json.dumps(row) for name in sorted(known) for row in known[name])
        a.file.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
