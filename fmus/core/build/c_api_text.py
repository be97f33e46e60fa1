# SPDX-License-Identifier: BSD-2-Clause
"""Templates of the files that c_api.py writes (C interface without FMI), and functions that format
C code.
"""

import math
import textwrap
from collections.abc import Iterable


def safe(words: str) -> str:
    """Return a text with `* /` in place of `*/`, which would end a C comment."""
    return words.replace("*/", "* /")


def commented(line: str, about: str) -> str:
    """Return the C declaration `line` with the comment `about` behind it, or above it if both do
    not fit into one line of 100 columns.
    """
    whole = f"{line} /* {safe(about)} */"
    if len(whole) <= 100:
        return whole
    folded = textwrap.wrap(safe(about), 90)
    return "\n".join(["    /* " + "\n     * ".join(folded) + " */", line])


def wrapped(header: str) -> str:
    """Return the text of a header with its opening comment wrapped to at most 100 columns. Indented
    lines are unchanged.
    """
    comment, end, rest = header.partition(" */\n")
    lines = [line.removeprefix("/*").removeprefix(" *").strip("\n") for line in comment.split("\n")]
    found: list[str] = []
    for part in _paragraphs(lines):
        found += part
    return "/*" + "\n".join(f" *{line}".rstrip() for line in found[:-1])[2:] + end + rest


def _paragraphs(lines: list[str]) -> Iterable[list[str]]:
    """Yield the lines of a comment in lists: the lines of a paragraph, wrapped to 94 columns, or
    one blank or indented line, unchanged.
    """
    waiting: list[str] = []
    for line in [*lines, ""]:
        if line.strip() and not line.startswith("    "):
            waiting.append(line.strip())
            continue
        yield textwrap.wrap(
            " ".join(waiting),
            94,
            initial_indent=" ",
            subsequent_indent=" ",
            break_on_hyphens=False,
        )
        waiting = []
        yield [line]


def number(value: float) -> str:
    """Return a double as the shortest C constant with the same bits."""
    return repr(float(value))


def bits(value: float) -> str:
    """Return a double as a hexadecimal C constant with its exact bits, NAN if it is not finite."""
    return value.hex() if math.isfinite(value) else "NAN"


def braced(values: Iterable[str]) -> str:
    """Return the C initializer of an array with these elements."""
    return "{" + ", ".join(values) + "}"


PART = """#define FMU_MODEL_SYMBOL {name}_model
#include "{name}.c"

extern const size_t {name}_model_inputs;
const size_t {name}_model_inputs = offsetof(Model, u) / sizeof(double);
"""

STRUCT = """typedef struct {name}_{struct} {{
{members}
}} ANY_ALIAS {name}_{struct};
"""

SCRATCH = """
/* working memory of {name}_init, not used afterwards */
typedef struct {name}_Scratch {{ double memory[{count}]; }} ANY_ALIAS {name}_Scratch;
"""

HEADER = """/* {name}.h - {about}.
 *
 * C interface without FMI, generated from the rows of {name}.c. The functions allocate nothing and
 * have no static variables, so any number of instances are independent. The caller owns all memory.
 *
 *     {name}_defaults(&p, &u);                        then set parameters and first inputs
 *     if ({name}_check(&p, text, sizeof text) > 0)    rejected parameters, with reasons in text
 *     {name}_init(&p, &u, &x, &y, start{call});
 *     for (double k = 0;; k++) {{
 *         ... write the inputs u ...
 *         if (!{name}_good(&u, NULL, NULL)) ...       inputs are rejected: do not step
 *         {name}_step(&p, &u, &x, &y, {name}_time(start, k, h), h);
 *         if (!{name}_good(NULL, &x, &y)) ...         results are rejected: restore copies of x, y
 *     }}
 *
 * The bits equal the bits of the FMU if the compiler does not contract or reorder operations
 * (-ffp-contract=off, with gcc also -fno-tree-slp-vectorize; no -ffast-math), and if the steps have
 * the times of the FMU: step k begins at {name}_time(), which is start + (k - 1) h + h, not
 * start + k h. Parameters stay constant
 * after {name}_init(). A step without a sample instant leaves y unchanged, so y must persist. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef {guard}_C_API_H
#define {guard}_C_API_H

#include <stddef.h>

#if defined __FAST_MATH__ || (defined __FINITE_MATH_ONLY__ && __FINITE_MATH_ONLY__)
#error "flight code needs exact arithmetic: compile without -ffast-math and -ffinite-math-only"
#endif

#ifndef ANY_ALIAS /* the model reads the same memory as structs of its own */
#if defined __GNUC__
#define ANY_ALIAS __attribute__((__may_alias__))
#else
#define ANY_ALIAS
#endif
#endif

#ifdef __cplusplus
extern "C" {{
#endif

{structs}
/* states, to be copied as a whole */
typedef struct {name}_State {{ double memory[{states}]; }} ANY_ALIAS {name}_State;
{work}
/* start values of the model */
void {name}_defaults({name}_Parameters *p, {name}_Input *u);

/* number of rejected parameters; text, if not NULL: their names, values and rules */
size_t {name}_check(const {name}_Parameters *p, char *text, size_t size);

/* states and first outputs at the start time t [s] */
void {name}_init(const {name}_Parameters *p, const {name}_Input *u,
                {name}_State *x, {name}_Output *y, double t{scratch});

/* step from t to t + h [s] with the inputs held; outputs at its end */
void {name}_step(const {name}_Parameters *p, const {name}_Input *u,
                {name}_State *x, {name}_Output *y, double t, double h);

/* 1: inputs, states and outputs are finite and satisfy their ranges, as the FMU requires; NULL: not
 * tested */
int {name}_good(const {name}_Input *u, const {name}_State *x, const {name}_Output *y);

/* begin of step k = 0, 1, 2, ... of length h, with the rounding of the FMU [s] */
double {name}_time(double start, double k, double h);

#ifdef __cplusplus
}}
#endif

#endif
"""

SOURCE = """/* {name}_api.c - the functions of {name}.h for the unedited model. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "{name}.h"

#if defined __GNUC__ && !defined __clang__ /* gcc 12 warns wrongly for some constant counts */
#pragma GCC diagnostic ignored "-Waggressive-loop-optimizations"
#endif

#define FMU_MODEL_SYMBOL {name}_model
#include "{name}.c"
#include "interface.h"

/* the structs of the interface and of the model have the same memory */
typedef char same_parameters[sizeof({name}_Parameters) == sizeof(Parameters) ? 1 : -1];
typedef char same_input[sizeof({name}_Input) == sizeof(Input) ? 1 : -1];
typedef char same_state[sizeof({name}_State) == sizeof(State) ? 1 : -1];
typedef char same_output[sizeof({name}_Output) == sizeof(Output) ? 1 : -1];

void {name}_defaults({name}_Parameters *p, {name}_Input *u)
{{
    memcpy(p, &start.p, sizeof *p);
    memcpy(u, &start.u, sizeof *u);
}}

size_t {name}_check(const {name}_Parameters *p, char *text, size_t size)
{{
    Problems problems = {{{{0}}, 0, ""}};
    check_parameters(&{name}_model, (void *)p, &problems); /* reads only */
    if (text && size > 0) snprintf(text, size, "%s", problems.text);
    return problems.count;
}}

void {name}_init(const {name}_Parameters *p, const {name}_Input *u,
                {name}_State *x, {name}_Output *y, double t{scratch})
{{
    memcpy(x, &start.x, sizeof *x);
    memcpy(y, &start.y, sizeof *y);
    initialize((const void *)p, (const void *)u, (void *)x, (void *)y, t{work});
}}

void {name}_step(const {name}_Parameters *p, const {name}_Input *u,
                {name}_State *x, {name}_Output *y, double t, double h)
{{
    step((const void *)p, (const void *)u, (void *)x, (void *)y, t, h);
}}

/* finite, and with the ranges of the rows; first: double of the model */
static bool good(Causality rows, const double values[], size_t count, size_t first)
{{
    return all_finite(values, count) && satisfy_rows(&{name}_model, rows, values, first);
}}

int {name}_good(const {name}_Input *u, const {name}_State *x, const {name}_Output *y)
{{
    const size_t of_u = offsetof(Model, u) / sizeof(double),
                 of_y = offsetof(Model, y) / sizeof(double);
    return (!u || good(INPUT_ROW, (const void *)u, sizeof *u / sizeof(double), of_u)) &&
           (!x || all_finite((const void *)x, sizeof *x / sizeof(double))) &&
           (!y || good(OUTPUT_ROW, (const void *)y, sizeof *y / sizeof(double), of_y));
}}

double {name}_time(double start_time, double k, double h)
{{
    return k > 0 ? start_time + (k - 1) * h + h : start_time;
}}
"""

TABLES_HEADER = """/* {name}_parameters.h - parameters of {name}, a table per parameter set. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef {guard}_PARAMETERS_H
#define {guard}_PARAMETERS_H

#include "{name}.h"

#ifdef __cplusplus
extern "C" {{
#endif

{tables}

#ifdef __cplusplus
}}
#endif

#endif
"""

TABLES_SOURCE = """/* {name}_parameters.c - the tables of {name}_parameters.h. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "{name}_parameters.h"

{tables}"""

ROWS = """/* {text} */
static const double rows_{number}[][WIDTH] = {{
{rows}
}};
"""

VECTORS = """/* {name}_vectors.h - reference vectors of the FMU.
 *
 * A row holds the time at which a step begins [s], the inputs of the step, and the outputs at its
 * end. The first row holds the outputs after initialization. */
/* SPDX-License-Identifier: BSD-2-Clause */
enum {{ WIDTH = {width} }};

{rows}
#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static const struct {{
    const {name}_Parameters *parameters;
    double h; /* s */
    const double (*row)[WIDTH];
    size_t count;
}} runs[] = {{
{runs}
}};
"""

TEST = """/* {name}_test.c - compares all bits of {name} with the reference vectors of the FMU. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "{name}_parameters.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "{name}_vectors.h"

static {name}_Input u;
static {name}_State x;
static {name}_Output y;

/* 1: all values are accepted, and the outputs have the bits of the row. A NAN in the row, where the
 * run of the FMU has no output, is not compared. */
static int equals(const double row[])
{{
    const double *expected = row + 1 + sizeof u / sizeof *row;
    for (size_t i = 0; i < sizeof y / sizeof *row; i++) {{
        const char *found = (const char *)&y + i * sizeof *row;
        if (expected[i] == expected[i] && memcmp(found, expected + i, sizeof *row) != 0) return 0;
    }}
    return {name}_good(&u, &x, &y);
}}

static int follows(const {name}_Parameters *p, const double row[], double h)
{{
    memcpy(&u, row + 1, sizeof u);
    {name}_step(p, &u, &x, &y, row[0], h);
    return equals(row);
}}

int main(void)
{{
{scratch}    char text[1000];
    for (size_t r = 0; r < COUNT(runs); r++) {{
        const double(*row)[WIDTH] = runs[r].row;
        if ({name}_check(runs[r].parameters, text, sizeof text) > 0) return puts(text), 1;
        memcpy(&u, row[0] + 1, sizeof u);
        {name}_init(runs[r].parameters, &u, &x, &y, row[0][0]{work});
        for (size_t i = 0; i < runs[r].count; i++)
            if (!(i ? follows(runs[r].parameters, row[i], runs[r].h) : equals(row[0])))
                return printf("{name}: row %zu differs\\n", i), 1;
        printf("{name}: %zu rows, all bits equal\\n", runs[r].count);
    }}
    return 0;
}}
"""

MAKEFILE = """CFLAGS = -std=c99 -O2 -Wall -Wextra
SAME_BITS = -ffp-contract=off -fno-tree-slp-vectorize -fno-math-errno
NAMES = @names@
libflight.a: $(NAMES:=_api.o) $(NAMES:=_parameters.o) ; $(AR) rcs $@ $^
%.o: %.c $(wildcard *.h) $(NAMES:=.c)
	$(CC) $(CFLAGS) $(SAME_BITS) -c $< -o $@
test: $(NAMES:=_test)
	for name in $(NAMES); do ./$${name}_test || exit 1; done
%_test: %_test.o libflight.a
	$(CC) $^ -lm -o $@
"""

CMAKELISTS = """cmake_minimum_required(VERSION 3.10)
project(flight C)
set(NAMES @names@)
enable_testing()
add_library(flight STATIC)
target_compile_options(flight PRIVATE -ffp-contract=off -fno-tree-slp-vectorize
  -fno-math-errno)
target_include_directories(flight PUBLIC ${CMAKE_CURRENT_SOURCE_DIR})
foreach(name ${NAMES})
  target_sources(flight PRIVATE ${name}_api.c ${name}_parameters.c)
  add_executable(${name}_test ${name}_test.c)
  target_link_libraries(${name}_test flight m)
  add_test(NAME ${name} COMMAND ${name}_test)
endforeach()
"""

BUILDS = {"Makefile": MAKEFILE, "CMakeLists.txt": CMAKELISTS}
