# SPDX-License-Identifier: BSD-2-Clause
"""Compile the FMU of a whole system (fuse.py) into a library that makes several runs at once, in
the lanes of vectors (core/lanes/lanes.h).

Usage: lanes.py SOURCES -o WHOLE.so [--width N] [--cxx COMMAND]

SOURCES is the folder with the C files of the unpacked FMU. They are compiled as C++ with a vector
(one number per run) in place of every double. Before that, `c ? a : b` and `if (c) return a; rest`
are rewritten as calls that select a or b for each run, since the condition c may differ between
runs, and `if (c) f(x, y);` as a call that performs f for the runs in which c holds.
"""

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import build_fmu

LANES = build_fmu.CORE / "lanes"
FLAGS = (
    "-std=gnu++20", "-O3", "-fPIC", "-fvisibility=hidden", "-fpermissive", "-w",
    "-fno-exceptions", "-Wno-address-of-temporary",
    *(flag for flag in build_fmu.SAME_BITS if not flag.startswith("-std")),
)  # fmt: skip
TARGET = {
    8: ("-mavx512f", "-mavx512dq", "-mavx512vl", "-mno-fma"),
    4: ("-mavx2", "-mno-fma"),
    2: (),
}
"""Compiler flags of the vector instructions, by number of lanes."""

# ---- C to C++ ----
TOKEN = re.compile(
    r"\s+|//[^\n]*|/\*.*?\*/|(?m:^[ \t]*\#(?:[^\\\n]|\\.)*)"
    r"|\"(?:[^\"\\]|\\.)*\"|'(?:[^'\\]|\\.)*'"
    r"|\d(?:[eEpP][+-]|[\w.])*|\.\d(?:[eE][+-]|\w)*|\w+"
    r"|<<=|>>=|->|\+\+|--|<<|>>|&&|\|\||[-+*/%&|^=!<>]=|.",
    re.DOTALL,
)
CLOSING = {"(": ")", "[": "]", "{": "}"}
BEFORE = {*"=,;:", "return", "else", *(f"{c}=" for c in "+-*/%&|^"), "<<=", ">>="}
"""Tokens after which an expression can begin."""

CONDITION = {"&&", "||", "<", ">", "<=", ">=", "==", "!="}
"""Operators whose value is a condition."""

TABLES = ("start", "variables")
"""Names of the tables of a model that a step does not use, so that they are left out."""
WORDS = {"class", "delete", "new", "operator", "private", "public", "template", "this", "typename"}
"""Keywords of C++ that may be names in C."""

Items = list[Any]
"""Parsed C text: a list of items, each a token, or a bracket with its content as a list [opening
bracket, item, ...].
"""


def parsed(text: str) -> Items:
    """Return the items of a C text without comments."""
    stack: list[Items] = [[]]
    for token in TOKEN.findall(text):
        if token in CLOSING:
            stack.append([token])
        elif token in CLOSING.values():
            group = stack.pop()
            stack[-1].append(group)
        elif token.lstrip().startswith("#"):
            stack[-1].append(f"\n{token}\n")
        elif not token.isspace() and not token.startswith(("//", "/*")):
            stack[-1].append(f"{token}_" if token in WORDS else token)
    return stack[0]


def written(items: Items) -> str:
    """Return parsed items (tokens and brackets with their content) as a C text again."""
    texts = (x if isinstance(x, str) else f"{x[0]}{written(x[1:])}{CLOSING[x[0]]}" for x in items)
    return " ".join(f"{text}\n" if text.endswith((";", "}")) else text for text in texts)


def is_block(item: Any) -> bool:
    """Return whether an item is a pair of braces with its content."""
    return isinstance(item, list) and item[0] == "{"


def conditionals(items: Items) -> Items:
    """Return items in which a call of lanes::choose() replaces every `c ? a : b`."""
    items = [x if isinstance(x, str) else [x[0], *conditionals(x[1:])] for x in items]
    if "?" not in items:
        return items
    at = items.index("?")
    begin = max((i + 1 for i, x in enumerate(items[:at]) if is_block(x) or starts(x)), default=0)
    colon, inner = at + 1, 0
    while inner or items[colon] != ":":
        inner += {"?": 1, ":": -1}.get(str(items[colon]), 0)
        colon += 1
    end = next((i for i in range(colon, len(items)) if items[i] in (",", ";")), len(items))
    a, b = conditionals(items[at + 1 : colon]), conditionals(items[colon + 1 : end])
    both = [", [&]", ["{", "return", *a, ";"], ", [&]", ["{", "return", *b, ";"]]
    call = ["(", *items[begin:at], *both]
    return [*items[:begin], "lanes::choose", call, *conditionals(items[end:])]


def starts(item: Any) -> bool:
    """Return whether an expression can begin after an item."""
    return isinstance(item, str) and item in BEFORE


def early_returns(body: Items, kind: str) -> Items:
    """Return the statements of a function in which a call of lanes::choose_as() replaces `if (c)
    return a; rest`; kind: the type that the function returns.
    """
    for i, item in enumerate(body[:-2]):
        if item == "if" and body[i + 2] == "return" and (i == 0 or ends(body[i - 1])):
            end = body.index(";", i)
            if end + 1 == len(body) or body[end + 1] == "else":
                return body
            rest = early_returns(body[end + 1 :], kind)
            value, test = body[i + 3 : end], body[i + 1][1:]
            function = f"[&]() -> {kind}"
            first = ["{", "return", *value, ";"]
            call = ["(", *test, ",", function, first, ",", function, ["{", *rest]]
            return [*body[:i], "return", f"lanes::choose_as<{kind}>", call, ";"]
    return body


def ends(item: Any) -> bool:
    """Return whether a statement ends with an item: a semicolon or a block in braces."""
    return item == ";" or is_block(item)


def designated(items: Items) -> Items:
    """Return items in which assignments replace the initializers with designators of structs and
    arrays, which C++ permits only in the order of the declaration.
    """
    found: Items = []
    for item in items:
        if is_block(item) and item[1:2] == ["."]:
            found += ["lanes::Made", ["{", "[&](auto &made)", ["{", *assignments("made", item)]]]
        elif is_block(item) and item[1:2] and item[1][0] == "[" and found[-1] == "=":
            begin = max((i + 1 for i, x in enumerate(found) if ends(x)), default=0)
            plain = [x for x in found[begin:-1] if x not in ("static", "const")]
            found[begin:] = [*plain, "= {};", *assignments(found[-3], item)]
        elif isinstance(item, list):
            found.append([item[0], *designated(item[1:])])
        else:
            found.append(item)
    return found


def assignments(name: str, item: Items) -> Items:
    """Return assignments to the variable `name` that replace an initializer with designators."""
    found: Items = []
    for part in separated(item[1:]):
        at = part.index("=")
        place, value = [name, *part[:at]], designated(part[at + 1 :])
        if is_block(value[0]):
            found += ["lanes::set", ["(", *place, ",", ["{", *value]], ";"]
        else:
            found += [*place, "=", *value, ";"]
    return found


def separated(items: Items) -> list[Items]:
    """Return the parts of items between commas, without empty ones."""
    parts: list[Items] = [[]]
    for item in items:
        if item == ",":
            parts.append([])
        else:
            parts[-1].append(item)
    return [part for part in parts if part]


def with_casts(items: Items) -> Items:
    """Return items of a C text in which the initial value of a pointer declaration `T *a = b;` is
    cast to `T *`, which C++ requires if b is a `void *`.
    """
    found: Items = []
    for i, item in enumerate(items):
        found.append(item if isinstance(item, str) else [item[0], *with_casts(item[1:])])
        if item == "=" and items[i - 2 : i - 1] == ["*"] and items[i + 2 : i + 3] == [";"]:
            begin = max((k + 1 for k, x in enumerate(items[:i]) if ends(x)), default=0)
            kind = items[begin : i - 2]
            if kind and all(map(is_name, kind)) and not {"else", "do"} & set(kind):
                found.append(["(", *(x for x in kind if x != "static"), "*"])
    return found


def is_name(item: Any) -> bool:
    """Return whether an item is a word."""
    return isinstance(item, str) and item.isidentifier()


def in_lanes(text: str) -> str:
    """Return a C file rewritten as C++ that uses lanes.h, without the tables of start values and
    variables.
    """
    items = parsed(text)
    begin = 0
    for i, item in enumerate(items):
        if is_block(item) and i and items[i - 1][:1] == ["("]:
            if "int" in items[begin:i] and is_condition(item[1:]):
                items[items.index("int", begin)] = "auto"
            items[i] = ["{", *function(items[begin:i], item[1:])]
        elif is_block(item) and any(name in items[begin:i] for name in TABLES):
            items[begin : i + 1] = [""] * (i + 1 - begin)
        if ends(item) or (isinstance(item, str) and item.startswith("\n")):
            begin = i + 1
    return written(items)


def function(head: Items, body: Items) -> Items:
    """Return the rewritten body of a function; head: the items in front of the body.

    The body of check() becomes empty, because lanes check no parameters. Early returns are
    rewritten, and functions with searches run separately for each lane, only if the function
    returns a value and writes through no argument.
    """
    head = [x for x in head if x not in ("static", "inline")]
    begin = max((k + 1 for k, x in enumerate(head[:-1]) if isinstance(x, list)), default=0)
    kind = " ".join(head[begin:-2])
    if head[-2] == "check":
        return []
    body = designated(with_casts(body))
    if kind in ("void", "int", "bool") or writes(head):
        return statements(conditionals(body))
    body = conditionals(early_returns(body, kind))
    if not searches(body):
        return body
    return ["return", f"lanes::apart<{kind}>", ["(", f"[=]() mutable -> {kind}", ["{", *body]], ";"]


def is_condition(body: Items) -> bool:
    """Return whether the body of a function is one statement that returns a condition."""
    top = [x for x in body if isinstance(x, str)]
    one = top[:1] == ["return"] and top.count(";") == 1 and "?" not in top
    return one and not CONDITION.isdisjoint(top)


def statements(items: Items) -> Items:
    """Return statements in which `if (c) f(x, y);` with arguments that call nothing is a call of
    where().
    """
    found: Items = []
    left = items
    while left:
        match left[:6]:
            case ["if", ["(", *test], str(name), ["(", *given], ";", *after] if (
                name != "return" and after != ["else"] and all(isinstance(x, str) for x in given)
            ):
                function = ["[&]", ["{", name, ["(", *given], ";"]]
                found += ["lanes::where", ["(", *test, ",", *function, ",", *given], ";"]
                left = left[5:]
            case [item, *_]:
                found.append(item if isinstance(item, str) else [item[0], *statements(item[1:])])
                left = left[1:]
    return found


def searches(items: Items) -> bool:
    """Return whether statements contain a `while`, or both a `for` and an `if`: the number of
    passes of such a loop may differ between lanes.
    """
    words = set(TOKEN.findall(written(items)))
    return "while" in words or {"for", "if"} <= words


def writes(head: Items) -> bool:
    """Return whether a function can write through an argument, or returns a pointer."""
    arguments = written(head[-1][1:]).split(",")
    return "*" in head or any(("*" in a or "[" in a) and "const" not in a for a in arguments)


# ---- library ----
SYSTEM = """#include "lanes.h"
#undef double
namespace scalar {{
namespace {{
#include "scalar/time_grid.h"
{types}
{tables}}}
}}
using scalar::CLOCK;
#define double lanes::Vector
{steps}
{step}
#undef double
#include "runs.h"
"""
MODEL = """#include "lanes.h"
namespace {{ /* all models have types of the same names */
#include "{model}.c"
}}
extern "C" __attribute__((visibility("default"))) int64_t {model}_splits;
int64_t {model}_splits;
namespace {{
struct Given {{
    const Parameters *p;
    const Input *u;
    State *x;
    Output *y;
    double t, h;
}};
}}
static void step_of(void *given)
{{
    const Given *g = (const Given *)given;
    step(g->p, g->u, g->x, g->y, g->t, g->h);
}}
void {model}_model_step(const void *p, const void *u, void *x, void *y, double t, double h)
{{
    Given all = {{(const Parameters *)p, (const Input *)u, (State *)x, (Output *)y, t, h}};
    lanes::step_in_lanes(step_of, &all, all.x, all.y, &{model}_splits);
    lanes::check_finite(all.x, all.y);
}}
"""
TYPES = re.compile(
    r"^(?:typedef (?:struct|enum)|enum) \{[^{}]*\}(?: (?:Phase|Progress|Snapshot))?;", re.M
)
"""Type definitions of the memory of a run. Only these are taken from TYPES_IN, because not every
compiler accepts the functions in these files as C++.
"""
TYPES_IN = ("interface.h", "instance.h", "state.c")
STEP = "void {}_model_step(const void *, const void *, void *, void *, double, double);"


def units(sources: Path) -> dict[str, str]:
    """Return the C++ files of the library by name; sources: the folder of system.c."""
    system = (sources / "system.c").read_text(encoding="utf-8")
    part = re.DOTALL | re.MULTILINE
    step = re.search(r"^static void step_system.*?^\}", system, part)
    tables = re.search(r"^enum \{ PARTS.*?(?=^static const (?:Copy|Part) )", system, part)
    assert step and tables  # as fused_source.py writes them
    models = re.findall(r"^extern Step (\w+)_model_step;", system, part)
    rows = "#define CHECKED_ROWS\n" if " checked[]" in tables[0] else ""
    steps = "\n".join(map(STEP.format, models))
    texts = [(sources / name).read_text(encoding="utf-8") for name in TYPES_IN]
    types = "\n".join(each for text in texts for each in TYPES.findall(text))
    pointer = step[0].replace("= model;", "= (double *)model;")
    found = {model: MODEL.format(model=model) for model in models}
    return found | {
        "": SYSTEM.format(types=types, tables=rows + tables[0], steps=steps, step=pointer)
    }


def build(sources: Path, output: Path, compiler: list[str], width: int, folder: Path) -> None:
    """Write the library with `width` lanes; raise CalledProcessError if the compiler fails.

    sources: folder with the C files of the FMU; folder: an empty one for intermediate files.
    """
    shutil.copytree(sources, folder / "scalar")
    for file in sources.glob("*.[ch]"):
        text = in_lanes(file.read_text(encoding="utf-8"))
        (folder / file.name).write_text(text, encoding="utf-8")
    for file in LANES.iterdir():
        shutil.copyfile(file, folder / file.name)
    command = [*compiler, *FLAGS, *TARGET[width], f"-DWIDTH={width}", f"-I{folder}"]

    def compiled(unit: tuple[str, str]) -> Path:
        path = folder / f"lanes_{unit[0]}.cpp"
        path.write_text(unit[1], encoding="utf-8")
        made = path.with_suffix(".o")
        subprocess.run([*command, "-c", path, "-o", made], check=True)
        return made

    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        objects = list(pool.map(compiled, units(sources).items()))
    without = ("-nostdlib++",) if is_clang(compiler) else ()
    subprocess.run([*command, "-shared", *without, *objects, "-o", output, "-lm"], check=True)


def is_clang(compiler: list[str]) -> bool:
    """Return whether a compiler is clang. With clang the C++ library is left out (-nostdlib++): the
    lanes do not use it, and zig would have to compile it first.
    """
    command = [*compiler, "--version"]
    return b"clang" in subprocess.run(command, check=True, capture_output=True).stdout


def main() -> None:
    """Run the command line that the docstring of this module describes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("sources", type=Path, help="folder with the C files of the unpacked FMU")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--width", type=int, choices=tuple(TARGET), default=4, help="runs at once")
    parser.add_argument(
        "--cxx", type=shlex.split, default=["g++"], help="compiler with its arguments"
    )
    a = parser.parse_args()
    try:
        with tempfile.TemporaryDirectory() as folder:
            build(a.sources, a.output, a.cxx, a.width, Path(folder))
    except (subprocess.CalledProcessError, OSError) as error:
        sys.exit(f"lanes.py: {error}" if isinstance(error, OSError) else 1)


if __name__ == "__main__":
    main()
