# SPDX-License-Identifier: BSD-2-Clause
"""Analysis of the C files in fmus/flight for the rules of flight code: calls, stack, loops, sizes.

    python fmus/core/build/flight_rules.py > docs/flight_code.md        (make flight-rules)

The compiler gcc lists the calls and the stack of every function (-fcallgraph-info=su). Calls are
analysed without optimisation, so that no function is inlined, and the stack with the optimisation
of the FMUs (-O2). tests/compliance/test_flight_code.py checks the rules with this module; run as a
program, the module prints the page docs/flight_code.md.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

FMUS = Path(__file__).resolve().parents[2]
FOLDERS = [FMUS / "core" / name for name in ("adapter", "maths", "models", "ports")]
INCLUDE = [f"-I{folder}" for folder in (*FOLDERS, FMUS / "flight")]
FLAGS = ["-std=c99", "-ffp-contract=off", "-fno-math-errno"]
ALLOCATION = {"malloc", "calloc", "realloc", "free", "aligned_alloc", "alloca"}
STEP, START = "step_model", "initialize_model"
CALL = 8
"""Size of a return address [bytes]."""

TOKEN = re.compile(
    r'""|\d(?:[eEpP][+-]|[\w.])*|\.\d(?:[eE][+-]|\w)*|#\s*define\s+\w+\(|\w+|<<=|>>=|->'
    r"|\+\+|--|<<|>>|&&|\|\||##|[-+*/%&|^=!<>]=|\S"
)
"""Regular expression for a token of a C source without comments. `#define NAME(` is one token,
because a blank before the parenthesis would turn the parameters of a macro into its text.
"""

LOOPS = (
    (r"< (before|number|rows->count);", "rows of the safety filter, at most 26"),
    (r"j <=? f(->|\.)count;|j < faces;",
     "points of the predicted drift, at most 33, or faces of the corridor, 9"),
    (r"failure <= 2 \* MOST_ROWS", "twice the 26 rows of the safety filter, plus 1"),
    (r"< joints;|= joints; \w+-- > 0", "joints of the arm, at most 7"),
    (r"pass < ARM_JOINTS && ", "7 joints: every pass fixes one of them"),
    (r"Sample s = first_sample", "samples between two communication points: h/period, rounded up"),
    (r"; \w+ <=? [A-Z_]+( [-+*/] (\d+|[A-Z_]+))*;|; \w+ < \d+;", "a constant"),
    (r"i < QUADRATURE && ", "16 steps of an integral from node to node"),
    (r"= \d+; \w+ > 0;|= [A-Z_ 1-]+; \w+-- > 0|= NODES - 1; k >= 0", "a constant, downwards"),
    (r"int k = nodes - 1; k >= 0|k < nodes;", "nodes of a path, NODES in flight software"),
    (r"intervals\((y|shape)\)", "FINE = 4 times the 120 intervals that check() allows, plus 1"),
    (r"< (unknowns|unknown_nodes|nodes);|j <= i;", "three unknowns for each of the 118 free nodes"),
    (r"\w+ = \S.*; \w+ < (n|m|j|k|i|columns|moving|used|count|length|to|m->count|D_AT);"
     r"|= n - 1; \w+ >= 0|= n; \w+-- > 0|k <= n;",
     "order of a matrix or length of a vector, at most a constant of every caller"),
    (r"while \(m\+\+ < k\)", "age of a late measurement, below HISTORY = 16 samples"),
    (r"x->(anchor_)?index < |j = x->anchor_index",
     "samples since the last processed one, or in the ring of 16"),
    (r"double k = 0; k < steps", "duration/max_step of the drift, both parameters"),
    (r"j < steps_of\[part\]", "30 or 50 steps of an escape"),
    (r"exchange < EXCHANGES", "EXCHANGES = 100"),
    (r"bound <= THRUSTERS", "16 thrusters, plus 1"),
    (r"int cut = 0;;", "CUTS = 100: left at cut == CUTS - 1"),
    (r"parts = 0; x\.s < 1", "MOST_PARTS = 65 536, then at most 42 parts, none of which is halved"),
    (r"while \(s < 1 && floor_of", "40 doublings of w, a power of two not below 2^-41"),
    (r"above_half && i < DIGIT_WORDS|shift > 0 && i < DIGIT_WORDS", "7 words"),
    (r"while \(at < 100", "98 bits"),
    (r"for \(;; r\.iterations\+\+\)|i <= r\.iterations", "iterations_max + 1, at most 31"),
    (r"i < \(int\)task->weight", "weight, a whole number up to 8"),
)  # fmt: skip
"""Pairs of a regular expression for the head of a loop, and the largest number of passes of such a
loop as text. The first expression that matches a head applies.
"""


# ---- sources ----
def sources() -> list[Path]:
    """Return the C files of the flight software."""
    return sorted((FMUS / "flight").glob("*.c"))


@cache
def included() -> list[Path]:
    """Return all files of the flight software: the C files and all headers that they include."""
    command = [*compiler(), *FLAGS, *INCLUDE, "-MM", *map(str, sources())]
    listed = run(command).replace("\\\n", " ").split()
    return sorted({Path(name).resolve() for name in listed if not name.endswith(":")})


def run(command: list[str], folder: Path | None = None) -> str:
    """Run a program and return its output."""
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=folder).stdout


def compiler() -> list[str]:
    """Return the command of the compiler from the environment variable CC, by default gcc."""
    return os.environ.get("CC", "gcc").split()


def has_call_graphs() -> bool:
    """Return whether the compiler can list calls and stack, as gcc from version 10 can."""
    if shutil.which(compiler()[0]) is None:
        return False
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "a.c").write_text("int a;\n")
        command = [*compiler(), "-fcallgraph-info=su", "-c", "a.c"]
        done = subprocess.run(command, cwd=folder, capture_output=True, check=False)
        return done.returncode == 0


def version() -> str:
    """Return the line in which the compiler states its version."""
    return run([*compiler(), "--version"]).splitlines()[0]


# ---- calls and stack ----
@dataclass
class Calls:
    """Call graph of one FMU. stack: size of the stack frame by function [bytes]; callees: names of
    called functions by function; unbounded: functions whose stack size gcc cannot bound.
    """

    stack: dict[str, int]
    callees: dict[str, set[str]]
    unbounded: list[str]

    def called(self, name: str) -> set[str]:
        """Return the functions that a function calls directly. If it calls through a pointer, all
        functions of pointed() are included, because the pointer may point to any of them.
        """
        direct = self.callees.get(name, set())
        if "__indirect_call" not in direct:
            return direct
        return (direct - {"__indirect_call"}) | self.pointed()

    def pointed(self) -> set[str]:
        """Return the functions that are never called by name, without those that the adapter calls:
        their names end in `_model`.
        """
        named = {callee for callees in self.callees.values() for callee in callees}
        return {f for f in self.stack if f not in named and not f.endswith("_model")}

    def reached(self, name: str) -> set[str]:
        """Return all functions that a function calls, directly or not."""
        found: set[str] = set()
        waiting = [name]
        while waiting:
            new = self.called(waiting.pop()) - found
            found |= new
            waiting.extend(new)
        return found

    def recursive(self) -> set[str]:
        """Return the functions that call themselves, directly or not."""
        return {name for name in self.stack if name in self.reached(name)}

    def depth(self, name: str) -> int:
        """Return the stack that a function and its deepest chain of calls need together [bytes],
        without functions of the C library.
        """
        below = (self.depth(callee) for callee in self.called(name) if callee in self.stack)
        return CALL + self.stack[name] + max(below, default=0)


@cache
def calls(source: Path, optimisation: str) -> Calls:
    """Return the call graph of a C file that is compiled with the option `optimisation`, such as
    "-O2".
    """
    with tempfile.TemporaryDirectory() as folder:
        options = [optimisation, "-fcallgraph-info=su", "-c", str(source), "-o", "model.o"]
        run([*compiler(), *FLAGS, *INCLUDE, *options], Path(folder))
        text = next(Path(folder).glob("*.ci")).read_text()
    found = Calls({}, {}, [])
    for title, label in re.findall(r'node: \{ title: "(.*?)" label: "(.*?)"', text):
        size = re.search(r"(\d+) bytes \((.*?)\)", label)
        if size:
            found.stack[short(title)] = int(size[1])
            if size[2] == "dynamic":
                found.unbounded.append(short(title))
    for source_name, target in re.findall(r'sourcename: "(.*?)" targetname: "(.*?)"', text):
        found.callees.setdefault(short(source_name), set()).add(short(target))
    return found


def short(title: str) -> str:
    """Return the name of a function from its title FILE:NAME in a call graph."""
    return title.rpartition(":")[2]


def writable(source: Path) -> list[str]:
    """Return the names of all writable variables (.data and .bss) of a C file. It is compiled with
    -fno-pie, because otherwise tables of constant pointers would count as writable.
    """
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "model.o"
        run([*compiler(), *FLAGS, *INCLUDE, "-fno-pie", "-c", str(source), "-o", str(program)])
        lines = [line.split() for line in run(["nm", str(program)]).splitlines()]
    return [words[-1] for words in lines if words[-2] in "BbDdC"]


# ---- text ----
def code(path: Path) -> str:
    """Return a source in which blanks replace comments /* */ and string literals, with the same
    line numbers.
    """
    blank = re.compile(r'/\*.*?\*/|"(?:\\.|[^"\\\n])*"', re.DOTALL)
    return blank.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), path.read_text())


def bare(path: Path) -> str:
    """Return the tokens of a source, with one blank between two tokens, and each preprocessor
    directive in a line of its own. Comments are left out, and `""` replaces a string literal or
    several in a row: descriptions and messages do not change what a model computes.
    """
    comment = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"', re.DOTALL)
    text = comment.sub(lambda m: '""' if m[0].startswith('"') else " ", path.read_text())
    tokens: list[str] = []
    for line in text.replace("\\\n", " ").splitlines():
        found = TOKEN.findall(line)
        tokens += ["\n", *found, "\n"] if line.lstrip().startswith("#") else found
    return re.sub(r'""( "")+', '""', " ".join(tokens))


def loops(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line number and head of every loop in a source: for (...), while (...) or do."""
    text = code(path)
    for found in re.finditer(r"\b(for|while|do)\b\s*(?=[({])", text):
        end = found.end()
        depth = 0
        while end < len(text):
            depth += {"(": 1, ")": -1}.get(text[end], 0)
            end += 1
            if depth == 0:
                break
        tail = " {" if text[end : end + 2] == " {" else ""
        yield (
            text.count("\n", 0, found.start()) + 1,
            " ".join(text[found.start() : end].split()) + tail,
        )


def bound(head: str) -> str | None:
    """Return the largest number of passes of a loop as text, from its head such as `for (i = 0; i <
    3; i++)`; None if no pattern of LOOPS matches the head.
    """
    return next((text for pattern, text in LOOPS if re.search(pattern, head)), None)


def longest_function(path: Path) -> int:
    """Return the number of lines of the longest function in a source, from the last line of its
    head to its closing brace.
    """
    text = code(path)
    bodies = re.finditer(r"^\{\n.*?^\}", text, re.DOTALL | re.MULTILINE)
    return max((body[0].count("\n") + 2 for body in bodies), default=0)


# ---- the page ----
def stack_rows() -> Iterator[str]:
    """Yield a table row per FMU with the stack of its initialization and of a step [bytes]."""
    for source in sources():
        graph = calls(source, "-O2")
        yield f"| `{source.stem}` | {graph.depth(START)} | {graph.depth(STEP)} |"


def loop_rows() -> Iterator[str]:
    """Yield a table row for each bound of LOOPS that occurs, with the number of loops that have it.
    The bound `?` represents all loops whose head matches no pattern of LOOPS.
    """
    heads = [bound(head) or "?" for path in included() for _, head in loops(path)]
    for text in sorted(set(heads), key=lambda t: (-heads.count(t), t)):
        yield f"| {heads.count(text)} | {text} |"


def page() -> str:
    """Return the text of docs/flight_code.md."""
    text = (Path(__file__).parent / "flight_code.md").read_text()
    longest = max(longest_function(path) for path in included())
    values = {
        "compiler": version(),
        "stack": "\n".join(stack_rows()),
        "loops": "\n".join(loop_rows()),
        "files": str(len(included())),
        "longest": str(longest),
    }
    for name, value in values.items():
        text = text.replace(f"@{name}@", value)
    return text


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    sys.stdout.write(page())
