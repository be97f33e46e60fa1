# SPDX-License-Identifier: BSD-2-Clause
"""Pages on the keys of system files and campaign files (TOML), with the meaning of each key. A test
compares the keys with the code.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from text import table

Keys = Mapping[str, Mapping[str, tuple[str, str]]]
"""For each table of the file ("" is the top level), a pair of type and meaning by key."""

SYSTEM: Keys = {
    "": {
        "name": ("text", "Name of the system; default: from the folder and the file"),
        "mission": ("text", "Mission with the figures and claims; default: from the folder"),
        "extends": ("text", "System that this file extends; this file holds only the differences"),
        "description": ("text", "One line for `harness list`"),
        "experiment": ("table", "Time span, macro step and order of execution"),
        "components": ("table", "FMU of every component, by name or by path from this file; with "
                       "Gauss-Seidel, components run in this order; in a file with `extends`, "
                       "`controller = false` adds the component `controller` to `without`"),
        "without": ("list", "Components that another tool runs: their outputs are inputs of the "
                    "system and start with their initial values in the whole system"),
        "schedule": ("table", "`[schedule.COMPONENT]`: rate and delay of a component"),
        "connections": ("table", "Connections between signals of different names: "
                        "`\"target.r_TN_N\" = \"filter.r_N\"`; signals of the same name are "
                        "connected"),
        "open": ("table", "Unconnected inputs and their values"),
        "parameters": ("table", "`[parameters.COMPONENT]`: values in SI units"),
        "start": ("table", "CCSDS OEM or two-line elements of a body, by path from this file, or "
                  "the elements themselves; `attitude`: frame of the start attitudes, `H` "
                  "(default) or `N`"),
        "sets": ("table", "`[sets.NAME]`: parameter sets for `--params`"),
        "alternatives": ("table", "`[alternatives.FMU]`: parameters that apply with `--swap`"),
        "requirements": ("table", "Conditions by name: `distance = \"guidance.range >= 4 m\"`"),
        "consistency": ("table", "Conditions on parameters by name; a note if one is violated"),
        "compare": ("table", "Defaults of `harness compare`"),
        "live": ("table", "What the reader of a live page may change: `harness report --live`"),
    },
    "experiment": {
        "start": ("number", "Start time [s]; default 0"),
        "stop": ("number", "Stop time [s]"),
        "step": ("number", "Macro step [s]"),
        "algorithm": ("text", "`gauss-seidel` (default) or `jacobi`"),
        "every": ("whole number", "Record every N-th macro step; default 1"),
        "epoch": ("date", "UTC of t = 0: direction to the Sun, dates of the result"),
    },
    "schedule.COMPONENT": {
        "every": ("whole number", "Step the component every N macro steps; default 1"),
        "latency": ("whole number", "Delay its outputs by N macro steps; default 0"),
    },
    "sets.NAME": {
        "description": ("text", "One line for `harness list`"),
        "experiment": ("table", "Time span and macro step of this parameter set"),
    },
    "compare": {
        "set": ("text", "Parameter set that `harness compare` runs without `--params`"),
    },
    "live": {
        "sliders": ("table", "Parameters and their ranges, `\"servicer.mass_0\" = [80, 130]`; "
                    "`[]`: range of the FMU"),
    },
    "sets.NAME.experiment": {
        "stop": ("number", "Stop time [s]"),
        "step": ("number", "Macro step [s]"),
    },
    "alternatives.FMU": {
        "replaces": ("text", "Component that the FMU replaces"),
    },
}  # fmt: skip
OF = "Requirements to study; default: all"
CAMPAIGN: Keys = {
    "": {
        "system": ("text", "Name of a system, or path of an .ssp or TOML from this file"),
        "runs": ("whole number", "Draws of every combination of the listed values"),
        "seed": ("whole number", "Seed of the draws"),
        "sampler": ("text", "`random` (default), `latin-hypercube` or `sobol`"),
        "every": ("whole number", "Record every N-th macro step of a run"),
        "patience": ("number", "Time limit of one call into a third-party FMU [s]"),
        "executor": ("text", "`c` (default), `python` or `fused`: all FMUs compiled into one"),
        "seeds": ("list of texts", "Parameters that get a seed of their own in every draw"),
        "success": ("text", "Expression that is true for a successful run"),
        "worst": ("text or table", "Metric that ranks the worst runs; `-NAME`: smallest first; "
                  "as a table, the study `harness worst`"),
        "until": ("table", "Instead of `runs`: end when the share `success` of successful runs is "
                  "shown or not, with `confidence`; or `fixed` or at most `most` runs"),
        "requirements": ("table", "Further requirements, by name"),
        "sensitivity": ("table", "Study `harness sensitivity`"),
        "coordinates": ("whole number", "Written by a study: number of standard "
                        "normal coordinates per run"),
        "fixed": ("table", "Changes that apply to all runs"),
        "factors": ("table", "Varied values, by parameter or change"),
        "metrics": ("table", "Expressions, metrics of `harness compare` or functions, by name"),
        "expected": ("table", "Smallest and largest mean of a metric: a verdict"),
        "record": ("table", "Time series to record"),
    },
    "fixed": {
        "params": ("text", "Parameter set or file"),
        "set": ("table", "Parameters"),
        "swap": ("table", "FMUs by component"),
        "map": ("table", "Names of ports in the system, by name in the swapped FMU"),
        "on": ("table", "Processors and boards by component"),
        "latency": ("table", "Macro steps of delay by component"),
        "step": ("number", "Macro step [s]"),
        "stop": ("number", "Stop time [s]"),
        "algorithm": ("text", "`gauss-seidel` or `jacobi`"),
        "epoch": ("text", "UTC of t = 0"),
    },
    "factors.NAME": {
        "list": ("list", "Listed values"),
        "range": ("table", "`first`, `last`, `count`: equally spaced listed values"),
        "normal": ("table", "`mean`, `sigma` or `covariance`, `within`"),
        "log_normal": ("table", "`median`, `sigma`"),
        "uniform": ("table", "`low`, `high`"),
        "rotation": ("table", "`sigma` [rad], `attitude`"),
        "inertia": ("table", "`principal`, `spread`, `axes`"),
    },
    "record": {
        "histories": ("list of texts", "Variables to record in every run"),
        "bands": ("list of texts", "Variables with percentiles over all runs"),
        "rows": ("whole number", "Approximate upper limit of the instants of a time series"),
    },
    "sensitivity": {
        "of": ("list of texts", OF),
        "method": ("text", "`morris` (default) or `sobol`"),
        "runs": ("whole number", "Approximate number of runs: whole paths of `morris`; points of "
                 "`sobol` are rounded up to a power of two; default 130"),
    },
    "worst": {
        "of": ("list of texts", OF),
        "runs": ("whole number", "Number of runs per requirement; default 200"),
        "box": ("number", "Largest distance of each coordinate from 0, in standard deviations; "
                "default 3"),
    },
}  # fmt: skip


def pages() -> Iterator[tuple[str, str]]:
    """Yield path and text of the pages on the keys of TOML files."""
    yield "reference/system_toml.md", page("System TOML", SYSTEM, SYSTEM_TEXT)
    yield "reference/campaign_toml.md", page("Campaign TOML", CAMPAIGN, CAMPAIGN_TEXT)


SYSTEM_TEXT = """`system.toml` describes one system: components, wiring, parameters and time span.
`harness check` lists its mistakes. How to write one: [Write a mission](../own_mission.md).
"""
CAMPAIGN_TEXT = """A campaign file names the system, the varied values and the recorded values.
`harness campaign` checks the whole file before the first run. Draws, expressions and files:
[Campaigns](../campaigns.md).
"""


def page(title: str, keys: Keys, text: str) -> str:
    """Return a page with a table of keys for every table of the TOML file."""
    parts = [f"# {title}\n", text]
    for name, entries in keys.items():
        heading = "Top level" if not name else f"`[{name}]`"
        parts.append(f"## {heading}\n")
        rows = [(f"`{key}`", kind, meaning) for key, (kind, meaning) in entries.items()]
        parts.append(table(("Key", "Value", "Meaning"), rows))
    return "\n".join(parts)
