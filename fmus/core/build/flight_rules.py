# SPDX-License-Identifier: BSD-2-Clause
"""What the rules of flight code look at: calls, stack, loops and sizes of fmus/flight.

    python fmus/core/build/flight_rules.py > docs/flight_code.md        (make flight-rules)

Calls and stack come from gcc (-fcallgraph-info=su), once without optimisation, where every function
is still there, and once as it is flown; the tests judge them.
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
"""Bytes of a return address."""

LOOPS = (
    (r"< joints;|= joints; \w+-- > 0", "joints of the arm, at most 7"),
    (r"pass < ARM_JOINTS && ", "7 joints, of which every pass fixes one"),
    (r"Sample s = first_sample", "samples between two communication points: h/period, rounded up"),
    (r"; \w+ <=? [A-Z_]+( [-+*/] (\d+|[A-Z_]+))*;|; \w+ < \d+;", "a constant"),
    (r"= \d+; \w+ > 0;|= [A-Z_ 1-]+; \w+-- > 0", "a constant, downwards"),
    (r"intervals\((y|shape)\)", "FINE = 4 times the 120 nodes that check() allows"),
    (r"< (unknowns|unknown_nodes|nodes);|j <= i;", "three times the 118 free nodes"),
    (r"\w+ = \S.*; \w+ < (n|m|j|k|i|columns|moving|length|to|m->count|D_AT);"
     r"|= n; \w+-- > 0|k <= n;",
     "order of a matrix or length of a vector, a constant of every caller"),
    (r"while \(n-- > 0\)", "free thrusters, at most 16"),
    (r"while \(m\+\+ < k\)", "age of a late measurement, below HISTORY = 16 samples"),
    (r"x->(anchor_)?index < |j = x->anchor_index", "samples since the last, or in the ring of 16"),
    (r"double k = 0; k < steps", "duration/max_step of the drift, both parameters"),
    (r"exchange < EXCHANGES", "EXCHANGES"),
    (r"bound <= THRUSTERS", "16 thrusters"),
    (r"int cut = 0;;", "CUTS: left at cut == CUTS - 1"),
    (r"parts = 0; x\.s < 1", "MOST_PARTS, then the rest of the arc is one part"),
    (r"while \(s < 1 && floor_of", "52: w is a power of two below 1"),
    (r"beyond && i < DIGIT_WORDS|left > 0 && i < DIGIT_WORDS", "7 words"),
    (r"while \(at < 100", "98 bits"),
    (r"for \(;; r\.iterations\+\+\)|i <= r\.iterations", "iterations_max, at most 30"),
    (r"int i = 0; i < count;", "16 steps from node to node"),
    (r"i < \(int\)task->weight", "weight, a whole number up to 8"),
)  # fmt: skip
"""Pattern of the head of a loop, and what bounds it: the first that fits."""


# ---- sources ----
def sources() -> list[Path]:
    """The C files of the flight software."""
    return sorted((FMUS / "flight").glob("*.c"))


@cache
def included() -> list[Path]:
    """All files of the flight software: sources, headers beside them, headers of the core."""
    command = [*compiler(), *FLAGS, *INCLUDE, "-MM", *map(str, sources())]
    listed = run(command).replace("\\\n", " ").split()
    return sorted({Path(name).resolve() for name in listed if not name.endswith(":")})


def run(command: list[str], folder: Path | None = None) -> str:
    """What a program prints."""
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=folder).stdout


def compiler() -> list[str]:
    """The gcc that tells calls and stack."""
    return os.environ.get("CC", "gcc").split()


def has_call_graphs() -> bool:
    """Whether the compiler is a gcc from 10 on."""
    if shutil.which(compiler()[0]) is None:
        return False
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "a.c").write_text("int a;\n")
        command = [*compiler(), "-fcallgraph-info=su", "-c", "a.c"]
        done = subprocess.run(command, cwd=folder, capture_output=True, check=False)
        return done.returncode == 0


def version() -> str:
    """Of the compiler."""
    return run([*compiler(), "--version"]).splitlines()[0]


# ---- calls and stack ----
@dataclass
class Calls:
    """Who calls whom in one FMU, and bytes on the stack by function."""

    stack: dict[str, int]
    callees: dict[str, set[str]]
    unbounded: list[str]

    def called(self, name: str) -> set[str]:
        """Direct callees; a call through a pointer reaches every function that nobody calls by
        name.
        """
        direct = self.callees.get(name, set())
        if "__indirect_call" not in direct:
            return direct
        return (direct - {"__indirect_call"}) | self.pointed()

    def pointed(self) -> set[str]:
        """Functions that are called by pointers only."""
        named = {callee for callees in self.callees.values() for callee in callees}
        return {f for f in self.stack if f not in named and not f.endswith("_model")}

    def reached(self, name: str) -> set[str]:
        """Everything below a function."""
        found: set[str] = set()
        waiting = [name]
        while waiting:
            new = self.called(waiting.pop()) - found
            found |= new
            waiting.extend(new)
        return found

    def recursive(self) -> set[str]:
        """Functions that reach themselves."""
        return {name for name in self.stack if name in self.reached(name)}

    def depth(self, name: str) -> int:
        """Bytes of the deepest chain of calls; of the C library's functions nothing."""
        below = (self.depth(callee) for callee in self.called(name) if callee in self.stack)
        return CALL + self.stack[name] + max(below, default=0)


@cache
@cache
def calls(source: Path, optimisation: str) -> Calls:
    """Of the object file of a source."""
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
    """The name of a function without its file."""
    return title.rpartition(":")[2]


def writable(source: Path) -> list[str]:
    """Symbols of an object file that can be written: .data and .bss. Without -fno-pie a table of
    constant pointers would be among them.
    """
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "model.o"
        run([*compiler(), *FLAGS, *INCLUDE, "-fno-pie", "-c", str(source), "-o", str(program)])
        lines = [line.split() for line in run(["nm", str(program)]).splitlines()]
    return [words[-1] for words in lines if words[-2] in "BbDdC"]


# ---- text ----
def code(path: Path) -> str:
    """A source without comments and texts, line by line as it was."""
    blank = re.compile(r'/\*.*?\*/|"(?:\\.|[^"\\\n])*"', re.DOTALL)
    return blank.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), path.read_text())


def loops(path: Path) -> Iterator[tuple[int, str]]:
    """(line, head) of every loop."""
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
    """What bounds a loop; None if no rule knows it."""
    return next((text for pattern, text in LOOPS if re.search(pattern, head)), None)


def longest_function(path: Path) -> int:
    """Lines of the longest function."""
    text = code(path)
    bodies = re.finditer(r"^\{\n.*?^\}", text, re.DOTALL | re.MULTILINE)
    return max((body[0].count("\n") + 2 for body in bodies), default=0)


# ---- the page ----
def stack_rows() -> Iterator[str]:
    """Bytes of stack of every FMU."""
    for source in sources():
        graph = calls(source, "-O2")
        yield f"| `{source.stem}` | {graph.depth(START)} | {graph.depth(STEP)} |"


def loop_rows() -> Iterator[str]:
    """Loops by what bounds them."""
    heads = [bound(head) or "?" for path in included() for _, head in loops(path)]
    for text in sorted(set(heads), key=lambda t: (-heads.count(t), t)):
        yield f"| {heads.count(text)} | {text} |"


def page() -> str:
    """docs/flight_code.md."""
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
