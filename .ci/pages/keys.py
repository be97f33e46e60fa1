# SPDX-License-Identifier: BSD-2-Clause
"""The keys of both TOML files, with what each means; the test compares them with the code."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from text import table

Keys = Mapping[str, Mapping[str, tuple[str, str]]]
"""By table of the file: key, what it holds, what it means."""

SYSTEM: Keys = {
    "": {
        "name": ("text", "Name of the system; default: from the folder and the file"),
        "mission": ("text", "Mission whose figures and claims apply; set from the folder"),
        "extends": ("text", "System that this file extends; this file holds only what differs"),
        "description": ("text", "One line for `harness list`"),
        "experiment": ("table", "Time span, macro step and order of execution"),
        "components": ("table", "FMU of every component, by name or by path from this file; with "
                       "Gauss-Seidel, components run in this order"),
        "schedule": ("table", "`[schedule.COMPONENT]`: rate and delay of a component"),
        "connections": ("table", "Connections between signals of different names: "
                        "`\"target.r_TN_N\" = \"filter.r_N\"`; signals of the same name connect "
                        "themselves"),
        "open": ("table", "Inputs without a driver and the values they hold"),
        "parameters": ("table", "`[parameters.COMPONENT]`: values in SI units"),
        "start": ("table", "CCSDS OEM or two-line elements of a body, by path from this file, or "
                  "the elements themselves"),
        "sets": ("table", "`[sets.NAME]`: parameter sets for `--params`"),
        "alternatives": ("table", "`[alternatives.FMU]`: parameters that come with `--swap`"),
        "requirements": ("table", "Conditions by name: `distance = \"guidance.range >= 4 m\"`"),
        "consistency": ("table", "Conditions on parameters by name; a note if one does not hold"),
        "compare": ("table", "Defaults of `harness compare`"),
        "fly": ("table", "What the reader of a live page may change: `harness report --fly`"),
        "scene": ("table", "`[scene.models]`: what the replay shows"),
    },
    "experiment": {
        "start": ("number", "Start time [s]; default 0"),
        "stop": ("number", "Stop time [s]"),
        "step": ("number", "Macro step [s]"),
        "algorithm": ("text", "`gauss-seidel` (default) or `jacobi`"),
        "every": ("whole number", "Record every N-th macro step; default 1"),
        "epoch": ("date", "UTC of t = 0: direction to the Sun, dates of the result"),
    },
    "schedule": {
        "every": ("whole number", "Step the component every N macro steps; default 1"),
        "latency": ("whole number", "Delay its outputs by N macro steps; default 0"),
    },
    "set": {
        "description": ("text", "One line for `harness list`"),
        "experiment": ("table", "Time span and macro step of this set"),
    },
    "compare": {
        "set": ("text", "Parameter set that `harness compare` runs without `--params`"),
    },
    "fly": {
        "sliders": ("table", "Parameters and their ranges, `\"servicer.mass_0\" = [80, 130]`; "
                    "`[]`: that of the FMU"),
    },
    "scene": {
        "models": ("table", "glTF file of a component, by path from this file: "
                   "`servicer = \"mine.glb\"`"),
    },
    "set experiment": {
        "stop": ("number", "Stop time [s]"),
        "step": ("number", "Macro step [s]"),
    },
    "alternatives": {
        "replaces": ("text", "Component that the FMU replaces"),
    },
}  # fmt: skip
OF = "Requirements; default: all"
FLIGHTS = "Runs in all"
BOX = "Standard deviations that each number may move"
CAMPAIGN: Keys = {
    "": {
        "system": ("text", "Name of a system, or path of an .ssp from this file"),
        "runs": ("whole number", "Draws of every combination of the listed values"),
        "seed": ("whole number", "Seed of the draws"),
        "sampler": ("text", "`random` (default), `latin-hypercube` or `sobol`"),
        "every": ("whole number", "Record every N-th macro step of a run"),
        "patience": ("number", "Time that a third-party FMU may take for one call [s]"),
        "executor": ("text", "`c` (default), `python` or `fused`: all FMUs compiled into one"),
        "seeds": ("list of texts", "Parameters that get a seed of their own in every draw"),
        "success": ("text", "Expression that is true for a successful run"),
        "worst": ("text or table", "Metric that ranks the worst runs; `-NAME`: smallest first; "
                  "as a table, the study `harness worst`"),
        "until": ("table", "Instead of `runs`: end when `success` is shown with `confidence`"),
        "requirements": ("table", "Further requirements, by name"),
        "sensitivity": ("table", "Study `harness sensitivity`"),
        "probability": ("table", "Study `harness probability`"),
        "map": ("table", "Study `harness boundary`"),
        "tune": ("table", "Study `harness tune`"),
        "asked": ("whole number", "Written by a study: numbers per run"),
        "fixed": ("table", "Changes that apply to all runs"),
        "factors": ("table", "What varies, by parameter or change"),
        "metrics": ("table", "Expressions, measures or functions, by name"),
        "expected": ("table", "Smallest and largest mean of a metric: a verdict"),
        "keep": ("table", "Histories to keep"),
    },
    "fixed": {
        "params": ("text", "Parameter set or file"),
        "set": ("table", "Parameters"),
        "swap": ("table", "FMUs by component"),
        "map": ("table", "Ports of a swapped FMU by their names in the system"),
        "on": ("table", "Places by component: a processor or a board"),
        "latency": ("table", "Macro steps of delay by component"),
        "step": ("number", "Macro step [s]"),
        "stop": ("number", "Stop time [s]"),
        "algorithm": ("text", "`gauss-seidel` or `jacobi`"),
        "epoch": ("text", "UTC of t = 0"),
    },
    "factors": {
        "list": ("list", "Values to go through"),
        "range": ("table", "`first`, `last`, `count`: equally spaced values to go through"),
        "normal": ("table", "`mean`, `sigma` or `covariance`, `within`"),
        "log_normal": ("table", "`median`, `sigma`"),
        "uniform": ("table", "`low`, `high`"),
        "rotation": ("table", "`sigma` [rad], `attitude`"),
        "inertia": ("table", "`principal`, `spread`, `axes`"),
    },
    "keep": {
        "histories": ("list of texts", "Variables to keep of every run"),
        "bands": ("list of texts", "Variables whose percentiles over all runs to keep"),
        "rows": ("whole number", "Instants of a history"),
    },
    "sensitivity": {
        "of": ("list of texts", OF),
        "method": ("text", "`morris` (default) or `sobol`"),
        "flights": ("whole number", FLIGHTS),
    },
    "worst": {
        "of": ("list of texts", OF),
        "flights": ("whole number", FLIGHTS),
        "box": ("number", BOX),
        "searches": ("whole number", "Independent searches that share the runs"),
    },
    "probability": {
        "of": ("text", "Requirement; default: the first one"),
        "method": ("text", "`subset` (default), `random` or `importance`"),
        "flights": ("whole number", FLIGHTS),
        "below": ("number", "Required bound of the probability: a verdict"),
        "centres": ("text", "Dataset of a study with failures: centres of `importance`"),
    },
    "map": {
        "of": ("text", "Requirement; default: the first one"),
        "factors": ("list of texts", "The two factors of the map"),
        "flights": ("whole number", FLIGHTS),
    },
    "tune": {
        "of": ("list of texts", OF),
        "gains": ("table", "Draws of the parameters to tune, as in `[factors]`"),
        "draws": ("whole number", "Runs of each candidate, beside the archive"),
        "archive": ("text", "Dataset of a study of the same factors: its worst runs"),
        "flights": ("whole number", FLIGHTS),
        "box": ("number", BOX),
    },
}  # fmt: skip


def pages() -> Iterator[tuple[str, str]]:
    """Pages of the site and their text."""
    yield "reference/system_toml.md", page("System TOML", SYSTEM, SYSTEM_TEXT)
    yield "reference/campaign_toml.md", page("Campaign TOML", CAMPAIGN, CAMPAIGN_TEXT)


SYSTEM_TEXT = """`system.toml` describes one system: components, wiring, parameters and time span.
`harness check` lists every mistake at once. How to write one: [Write a mission](../own_mission.md).
"""
CAMPAIGN_TEXT = """A campaign file names the system to run, what to vary and what to keep.
`harness campaign` checks all of it before the first run. Draws, expressions and files:
[Campaigns](../campaigns.md).
"""


def page(title: str, keys: Keys, text: str) -> str:
    """One page with a table per table of the file."""
    parts = [f"# {title}\n", text]
    for name, entries in keys.items():
        heading = "Top level" if not name else f"`[{name}]`"
        parts.append(f"## {heading.replace('set experiment', 'sets.NAME.experiment')}\n")
        rows = [(f"`{key}`", kind, meaning) for key, (kind, meaning) in entries.items()]
        parts.append(table(("Key", "Value", "Meaning"), rows))
    return "\n".join(parts)
