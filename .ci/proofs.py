# SPDX-License-Identifier: BSD-2-Clause
"""Prove the absence of run-time errors in flight software with Frama-C Eva.

    python .ci/proofs.py FOLDER [COMPONENT...]        (make proofs)

Eva follows all values at once: every parameter and input that the table of variables of a component
allows, for any number of steps of 1e-9 to 1e5 s, at all times within +-1e9 s. It reports an alarm
where it cannot exclude an index outside its array, an integer overflow, an undefined shift, a
conversion of a number to a type that cannot hold it, or a read of uninitialized memory. Infinite
numbers and NaN are allowed and raise no alarm.

Eva follows the values of the parameters in SPLIT one by one, of all others at once. Options differ
by component only in the number of states that Eva follows separately (MORE): a smaller number can
add alarms, but never hides one. Eva starts from a working memory of zeros, as the adapter allocates
it: a read of working memory that `initialize` has not written raises no alarm.

Stubs: `sqrt`, `fabs` and `copysign` come from Frama-C; the stub of `reject`, which writes the
texts of rejected parameters before the first step, only records that a parameter is rejected.
"""

import argparse
import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from fmus.core.build import flight_rules

sys.path.insert(0, str(flight_rules.FMUS / "core" / "build"))
from c_api import layouts
from fused_layout import INPUT, PARAMETER, RULES, Model, Row

WHOLE = {
    "joints": (0, 7),
    "nodes": (8, 120),
    "scheme": (0, 2),
    "filter": (0, 3),
    "passive_points": (2, 32),
    "weight": (0, 8),
    "iterations_max": (0, 30),
    "iterations": (9, 60),
    "iterations_first": (9, 1200),
}
"""Parameters that the function `check` of a component limits to whole numbers, with the smallest
and the largest permitted value.
"""
SPLIT = ("joints",)
"""Parameters whose values Eva follows one by one, because they limit the indices of arrays."""
OPTIONS = (
    *("-machdep", "gcc_x86_64", "-c11", "-warn-special-float", "none"),
    *("-eva", "-eva-no-show-progress", "-eva-auto-loop-unroll", "128"),
)
MORE = {
    "arm_guidance": (
        *("-eva-slevel-function", "solve_pass:2000"),
        *("-eva-split-return-function", "solve_upper:1"),
    ),
    "optimal_controller": (
        *("-eva-auto-loop-unroll", "16", "-eva-widening-delay", "16"),
        *("-eva-slevel-function", "sweep:80", "-eva-slevel-function", "set_constraints:1000"),
    ),
    "transposition_guidance": ("-eva-auto-loop-unroll", "16"),
}
"""Further options of Eva by component: up to how many passes of a loop, and how many states of a
function, Eva follows separately.
"""
PROGRAM = """#define reject reject_with_text
#include "fmu.h"
#undef reject
#include "__fc_builtin.h"
static void reject(Problems *all, const char *name, double value, const char *rule)
{{
    (void)name, (void)value, (void)rule;
    all->count = 1;
}}
#include "{source}"

static Model m;
{scratch}
static void set_inputs(void)
{{
    double *x = (double *)&m;
{inputs}
}}

int main(void)
{{
    Problems problems = {{{{0}}, 0, ""}};
    double *x = (double *)&m;
{parameters}
    check(&m.p, &problems);
    set_inputs();
    initialize(&m.p, &m.u, &m.x, &m.y, Frama_C_double_interval(-1e9, 1e9){work});
    while (Frama_C_interval(0, 1)) {{
        set_inputs();
        step(&m.p, &m.u, &m.x, &m.y, Frama_C_double_interval(-1e9, 1e9),
             Frama_C_double_interval(1e-9, 1e5));
    }}
    return 0;
}}
"""
LARGEST = 1.7976931348623157e308
SMALLEST = 5e-324


class Proof(NamedTuple):
    """Outcome of Eva for a component: alarms as file, line and rule; numbers of functions and
    statements reached; error: why the analysis gave no outcome ("" if it gave one).
    """

    name: str
    alarms: tuple[str, ...]
    functions: int
    statements: int
    error: str = ""


def assignments(model: Model, causality: int) -> Iterator[str]:
    """Yield the C statements that give every element of the variables of a causality (INPUT or
    PARAMETER) any value of its range.
    """
    for row in model.rows:
        if row.causality != causality:
            continue
        for i in range(row.first, row.first + row.size):
            if row.name in SPLIT:
                yield f"    int {row.name} = {values_of(row)};\n    //@ split {row.name};"
                yield f"    x[{i}] = {row.name};"
            else:
                yield f"    x[{i}] = {values_of(row)};"


def values_of(row: Row) -> str:
    """Return the C expression for any value in the range of a row of the table of variables."""
    rule = RULES[row.rule]
    if row.name in WHOLE:
        low, high = WHOLE[row.name]
        return f"Frama_C_interval({low}, {high})"
    if rule in ("SWITCH_VALUE", "ALARM_VALUE"):
        return "Frama_C_interval(0, 1)"
    smallest = {"ANY_VALUE": -LARGEST, "POSITIVE_VALUE": SMALLEST}.get(rule, 0.0)
    return f"Frama_C_double_interval({smallest!r}, {LARGEST!r})"


def program(source: Path, model: Model) -> str:
    """Return the C program that Eva analyses."""
    work = re.search(r"FMU_MODEL_WITH\((\w+),", source.read_text(encoding="utf-8"))
    return PROGRAM.format(
        source=source,
        scratch=f"static {work[1]} scratch;" if work else "",
        work=", &scratch" if work else "",
        inputs="\n".join(assignments(model, INPUT)) or "    (void)x;",
        parameters="\n".join(assignments(model, PARAMETER)),
    )


def prove(source: Path, model: Model, folder: Path, seconds: int = 600) -> Proof:
    """Analyse a component with Eva and return the outcome; the log remains in the folder. If
    the folder has an outcome of the same program with the same headers and options, return that
    outcome without another analysis. seconds: limit of processor time.
    """
    file, log = folder / f"{source.stem}.c", folder / f"{source.stem}.log"
    file.write_text(program(source, model), encoding="utf-8")
    include = " ".join(flight_rules.INCLUDE)
    more = MORE.get(source.stem, ())
    command = ["frama-c", f"-cpp-extra-args={include}", *OPTIONS, *more, str(file)]
    recorded, about = folder / f"{source.stem}.json", key(command, file, source)
    if recorded.exists() and (known := json.loads(recorded.read_text("utf-8")))["key"] == about:
        return Proof(**known["proof"] | {"alarms": tuple(known["proof"]["alarms"])})
    done = subprocess.run(
        ["prlimit", f"--cpu={seconds}", *command], capture_output=True, text=True, check=False
    )
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return Proof(source.stem, (), 0, 0, f"Eva did not end within {seconds} s of processor time")
    log.write_text(done.stdout + done.stderr, encoding="utf-8")
    proof = read_log(source.stem, done.stdout + done.stderr)
    if not proof.error:
        recorded.write_text(json.dumps({"key": about, "proof": proof._asdict()}), encoding="utf-8")
    return proof


def files(source: Path) -> list[Path]:
    """Return a C file and all headers of the project that it includes."""
    command = [*flight_rules.compiler(), *flight_rules.FLAGS, *flight_rules.INCLUDE, "-MM", source]
    listed = flight_rules.run([str(word) for word in command]).replace("\\\n", " ").split()[1:]
    return sorted({Path(name).resolve() for name in listed})


def key(command: list[str], file: Path, source: Path) -> str:
    """Return the hash of an analysis: options, program and all files that it includes."""
    about = sha256(repr(command[:-1]).encode() + file.read_bytes())
    for path in files(source):
        about.update(path.read_bytes())
    return about.hexdigest()


def read_log(name: str, log: str) -> Proof:
    """Return the outcome from the log of Eva."""
    if "alarms generated" not in log and "alarm generated" not in log:
        return Proof(name, (), 0, 0, log.strip().splitlines()[-1] if log.strip() else "no output")
    found = re.findall(r"\[eva:alarm\] (\S+?):(\d+): Warning: *\n((?: +.*\n)+)", log)
    root = str(flight_rules.FMUS.parent) + "/"
    alarms = (
        f"{file.replace(root, '')}:{line}: {' '.join(why.split())}" for file, line, why in found
    )
    functions = re.search(r"(\d+) functions? analyzed", log)
    statements = re.search(r"(\d+) statements? reached", log)
    return Proof(
        name, tuple(alarms), int(functions[1]) if functions else 0,
        int(statements[1]) if statements else 0,
    )  # fmt: skip


def models() -> dict[str, Model]:
    """Return the tables of variables of all flight software by name of the component."""
    names = [source.stem for source in flight_rules.sources()]
    return layouts(names, flight_rules.FMUS / "flight", ["cc", *flight_rules.INCLUDE])


def main() -> None:
    """Run the command line, see the docstring of the module."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("components", nargs="*")
    a = parser.parse_args()
    a.folder.mkdir(parents=True, exist_ok=True)
    known, wrong = models(), False
    for source in flight_rules.sources():
        if a.components and source.stem not in a.components:
            continue
        proof = prove(source, known[source.stem], a.folder)
        wrong |= bool(proof.error or proof.alarms)
        outcome = proof.error or f"{len(proof.alarms)} alarms"
        counts = f"{proof.functions} functions, {proof.statements} statements"
        print(f"{source.stem}: {outcome}; {counts}", flush=True)
        for alarm in proof.alarms:
            print(f"    {alarm}", flush=True)
    sys.exit(wrong)


if __name__ == "__main__":
    main()
