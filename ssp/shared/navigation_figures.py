# SPDX-License-Identifier: BSD-2-Clause
"""Figures of navigation: errors of the estimates with 3-sigma bands, innovations and normalised
errors with chi-square bounds, availability of the sensors, true and estimated tracking errors.
"""

from __future__ import annotations

import numpy as np

from harness.figures.style import legend_above, time_axis
from harness.mission.figure import AXES, Axes, Drawing
from harness.results.result import Result

from .estimates import (
    FIXES,
    KINDS,
    MOTION,
    NIS,
    SENSORS,
    STAMPS,
    availability,
    bounds,
    errors,
    innovations,
    moving_mean,
    normalised,
    rows,
    tracking,
)

AVERAGED = 50
"""Largest number of successive measurements whose normalised squared innovations are averaged."""
BAND = 3
"""Half width of a band in standard deviations."""


def _draw_errors(canvas: Axes, result: Result) -> None:
    clock = time_axis(result.time)
    time = result.time[rows(result)[0]] / clock.seconds
    panels = canvas.subplots(4, 1, sharex=True)
    for panel, part in zip(panels, errors(result), strict=True):
        for k, axis in enumerate(AXES):
            panel.plot(time, part.factor * part.error[:, k], lw=0.7, label=axis, color=f"C{k}")
            for side in (-BAND, BAND):
                panel.plot(time, side * part.factor * part.sigma[:, k], "--", lw=0.6, color=f"C{k}")
        late = part.sigma[len(time) // 20 :]
        panel.set_ylim(*(np.array((-8, 8)) * part.factor * np.median(late)))
        panel.set_ylabel(part.title)
    legend_above(panels[0])
    panels[-1].set_xlabel(clock.label)


def _draw_innovations(canvas: Axes, result: Result) -> None:
    clock = time_axis(result.time)
    panels = canvas.subplots(3, 1, sharex=True)
    for panel, (label, filter_, name, stamp, degrees) in zip(panels, KINDS, strict=True):
        time, nis = innovations(result, filter_, name, stamp)
        time = time / clock.seconds
        panel.plot(time, nis, ".", ms=2, alpha=0.4)
        count = min(AVERAGED, len(nis))
        if count:
            panel.plot(time[count - 1 :], moving_mean(nis, count), label=f"mean of {count}")
            for level in bounds(degrees, count):
                panel.axhline(level, ls="--", lw=0.8, color="k")
        panel.set(ylabel=f"NIS, {label}", ylim=(0, 4 * degrees))
        legend_above(panel)
    panels[-1].set_xlabel(clock.label)


def _draw_normalised(canvas: Axes, result: Result) -> None:
    clock = time_axis(result.time)
    time = result.time[rows(result)[0]] / clock.seconds
    panels = canvas.subplots(4, 1, sharex=True)
    for panel, part in zip(panels, errors(result), strict=True):
        panel.semilogy(time, normalised(part), lw=0.6)
        for level in bounds(3):
            panel.axhline(level, ls="--", lw=0.8, color="k")
        panel.set_ylabel(part.title.partition(" [")[0])
    panels[-1].set_xlabel(clock.label)


# ---- sensors, tracking


def _draw_availability(canvas: Axes, result: Result) -> None:
    clock = time_axis(result.time)
    panel = canvas.subplots()
    names = (*SENSORS, *FIXES)
    time = result.time / clock.seconds
    for level, name in enumerate(names):
        panel.fill_between(time, level, level + 0.8 * (result[name] > 0), step="pre", lw=0)
    labels = [f"{n.partition('.')[0]}\n{100 * availability(result, n):.1f} %" for n in names]
    panel.set_yticks([k + 0.4 for k in range(len(names))], labels)
    panel.set_xlabel(clock.label)


def _draw_tracking(canvas: Axes, result: Result) -> None:
    clock = time_axis(result.time)
    time = result.time[rows(result)[0]] / clock.seconds
    panel = canvas.subplots()
    for values, label in zip(tracking(result), ("in truth", "on estimates"), strict=True):
        panel.semilogy(time, values, lw=0.8, label=label)
    panel.set(xlabel=clock.label, ylabel="distance from the reference [m]")
    legend_above(panel)


FIGURES: tuple[Drawing, ...] = (
    Drawing(
        "estimate_errors",
        "Errors of the estimated relative motion, 3-sigma bands",
        MOTION,
        _draw_errors,
        (11, 9),
    ),
    Drawing(
        "innovations",
        "Normalised innovations squared, chi-square bounds of 95 %",
        (*NIS, *STAMPS),
        _draw_innovations,
        (11, 7),
    ),
    Drawing(
        "normalised_errors",
        "Errors squared over variances, three axes each, chi-square bounds of 95 %",
        MOTION,
        _draw_normalised,
        (11, 9),
    ),
    Drawing(
        "availability",
        "Availability of the sensors",
        (*SENSORS, *FIXES),
        _draw_availability,
        (11, 3),
    ),
    Drawing(
        "tracking_on_estimates",
        "Tracking error in truth and on estimates",
        (*MOTION, "guidance.rho_ref_N"),
        _draw_tracking,
        (11, 4),
    ),
)
