# SPDX-License-Identifier: BSD-2-Clause
"""One third-party FMU with many vices: the environment selects which one, and in which FMI
function.

`VICE` is a name of VICES and `PHASE` one of PHASES, `AFTER` the number of calls before. The same
binary behaves well without them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from tests.harness import third_party_fmu
from tests.harness.third_party_fmu import Model, p, source_text, u, x, y

PHASES = (
    "load",
    "fmi2Instantiate",
    "fmi2SetReal",
    "fmi2SetupExperiment",
    "fmi2EnterInitializationMode",
    "fmi2ExitInitializationMode",
    "fmi2GetReal",
    "fmi2DoStep",
    "fmi2Terminate",
    "fmi2FreeInstance",
)

CRASH, QUIET, FAIL, HANG = "crash", "quiet", "fail", "hang"


@dataclass(frozen=True)
class Vice:
    """What it does (C), and what that means: the process crashes, nothing that the master can see,
    a status that fails, or it never returns.
    """

    code: str
    kind: str


VICES = {
    "segfault": Vice("*(volatile int *)0 = 1;", CRASH),
    "abort": Vice("abort();", CRASH),
    "exit_0": Vice("exit(0);", CRASH),
    "exit_3": Vice("exit(3);", CRASH),
    "fast_exit": Vice("_exit(0);", CRASH),
    "trap": Vice("__builtin_trap();", CRASH),
    "division": Vice("raise(SIGFPE);", CRASH),
    "bus_error": Vice("raise(SIGBUS);", CRASH),
    "kill_itself": Vice("kill(getpid(), SIGKILL);", CRASH),
    "kill_group": Vice("kill(0, SIGKILL);", CRASH),
    "stack": Vice("deep(1);", CRASH),
    "double_free": Vice("void *m = malloc(40); free(m); free(m);", CRASH),
    "wild_write": Vice("memset((void *)&vice, 1, 1 << 24);", CRASH),
    "wild_jump": Vice("((void (*)(void))16)();", CRASH),
    "ignored_segfault": Vice("signal(SIGSEGV, SIG_IGN); *(volatile int *)0 = 1;", CRASH),
    "alarm": Vice("raise(SIGALRM);", CRASH),
    "last_words": Vice('fputs("ran out of fuel\\n", stderr); abort();', CRASH),
    "user_signal": Vice("raise(SIGUSR1);", CRASH),
    "chdir": Vice('if (chdir("/")) return;', QUIET),
    "noise": Vice('puts("hello"); fflush(stdout);', QUIET),
    "noise_on_stderr": Vice('fputs("hello\\n", stderr);', QUIET),
    "flood": Vice('for (int i = 0; i < 20000; i++) puts("hello, hello"); fflush(stdout);', QUIET),
    "binary_noise": Vice("for (int i = 0; i < 300; i++) putchar(i); fflush(stdout);", QUIET),
    "close_stdout": Vice("close(1);", QUIET),
    "close_stderr": Vice("close(2);", QUIET),
    "close_stdin": Vice("close(0);", QUIET),
    "read_stdin": Vice("getchar();", QUIET),
    "interrupt_itself": Vice("raise(SIGINT);", QUIET),
    "terminate_itself": Vice("raise(SIGTERM);", QUIET),
    "hang_up": Vice("raise(SIGHUP);", QUIET),
    "terminate_group": Vice("kill(0, SIGTERM);", QUIET),
    "umask": Vice("umask(0777);", QUIET),
    "locale": Vice('setlocale(LC_ALL, "C"); setenv("LC_ALL", "xx_YY", 1);', QUIET),
    "environment": Vice("clearenv();", QUIET),
    "no_memory_given_back": Vice("memset(malloc(1 << 22), 1, 1 << 22);", QUIET),
    "priority": Vice("errno = nice(5);", QUIET),
    "file_in_folder": Vice('FILE *f = fopen("left.tmp", "w"); if (f) fclose(f);', QUIET),
    "error": Vice("status = 3;", FAIL),
    "fatal": Vice("status = 4;", FAIL),
    "discard": Vice("status = 2;", FAIL),
    "unknown_status": Vice("status = 77;", FAIL),
    "negative_status": Vice("status = -3;", FAIL),
    "close_all": Vice("for (int i = 0; i < 256; i++) close(i); abort();", CRASH),
    "garbage_everywhere": Vice(
        'for (int i = 3; i < 64; i++) if (write(i, "garbage!garbage!", 16) < 0) errno = 0;'
        " abort();",
        CRASH,
    ),
    "endless_loop": Vice("for (;;) spin++;", HANG),
    "endless_sleep": Vice("for (;;) sleep(1);", HANG),
}

HEAD = r"""
#define _GNU_SOURCE
#include <errno.h>
#include <locale.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
static volatile int spin;
static int status;
static volatile int deep(int n) { volatile char part[4096]; part[n % 4096] = 1;
    return deep(n + 1) + part[0]; }
static void vice(const char *phase)
{
    static int calls;
    const char *name = getenv("VICE"), *where = getenv("PHASE"), *after = getenv("AFTER");
    status = 0;
    if (!name || !where || strcmp(where, phase) || calls++ < (after ? atoi(after) : 0)) return;
    FILE *trace = getenv("TRACE") ? fopen(getenv("TRACE"), "w") : NULL;
    if (trace) fclose(trace);
@VICES@
}
static __attribute__((constructor)) void load(void) { vice("load"); }
"""

MODEL = Model(
    "vicious",
    [u("u"), y("y"), p("k", 1.0), p("y_0"), x("z")],
    outputs="y = y_0 + z + k * u;",
    step="z += h;",
)
GOOD = Model("good", MODEL.variables, MODEL.outputs, MODEL.step)


def source(model: Model) -> str:
    """The model with a call of its vice at the head of every FMI function."""
    chain = "".join(f'    if (!strcmp(name, "{n}")) {{ {v.code} }}\n' for n, v in VICES.items())

    def head(match: re.Match[str]) -> str:
        function, arguments, body = match.groups()
        check = "" if function in NO_STATUS else "if (status) return (fmi2Status)status;"
        rest = {"NOTHING": "return fmi2OK; }", "ERROR": "return fmi2Error; }"}.get(body, "")
        return f'{function}({arguments}) {{ vice("{function}"); {check} {rest}'

    text = source_text(model)
    return HEAD.replace("@VICES@", chain) + re.sub(
        r"(fmi2\w+)\(([^()]*)\)\s*(\{|NOTHING|ERROR)", head, text
    )


NO_STATUS = ("fmi2Instantiate", "fmi2FreeInstance", "fmi2GetTypesPlatform", "fmi2GetVersion")


def build(folder: Path) -> tuple[Path, Path]:
    """The vicious FMU and a good one of the same model."""
    return (
        third_party_fmu.build(MODEL, folder, source(MODEL)),
        third_party_fmu.build(GOOD, folder),
    )
