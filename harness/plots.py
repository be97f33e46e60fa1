"""PNG figures of a result: which figures there are is a table; a figure is drawn if the result holds its variables.

For the synchronised approach they are the counterparts of figures 4 to 11 of Zhu & Yang 2009.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import ResultsError
from harness.results import Result

Array = NDArray[np.float64]
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Curve:
    """One variable of a panel, all its elements; `convert` maps its history to what is drawn."""

    variable: str
    label: str = ""
    convert: Callable[[Array], Array] | None = None
    labels: tuple[str, ...] = AXES
    style: str = "-"


@dataclass(frozen=True)
class Panel:
    """One pair of axes over time."""

    ylabel: str
    curves: tuple[Curve, ...]
    after: float = 0.0
    """Start of the time axis [s]."""
    log: bool = False


@dataclass(frozen=True)
class Figure:
    """A figure: file name, title, panels from top to bottom."""

    name: str
    title: str
    panels: tuple[Panel, ...]

    def variables(self) -> set[str]:
        """What the result must hold."""
        return {curve.variable for panel in self.panels for curve in panel.curves}


def _degrees(x: Array) -> Array:
    return np.asarray(np.degrees(x))


def _norm(x: Array) -> Array:
    return np.asarray(np.linalg.norm(x, axis=1))


def _mrp_angle(sigma: Array) -> Array:
    """Rotation angle of modified Rodrigues parameters [deg]."""
    return _degrees(4 * np.arctan(_norm(sigma)))


J_LABELS = ("J11", "J12", "J13", "J22", "J23", "J33")
A_LABELS = ("A11", "A12", "A13", "A22", "A23", "A33")
ATTITUDE_START = 1200.0
"""Start of attitude control in the case of the paper [s]."""

FIGURES = (
    Figure("range", "Range", (Panel("range [m]", (Curve("guidance.range"),)),)),
    Figure(
        "force",
        "Control force",
        (
            Panel("Hill axes [N]", (Curve("controller.F_cmd_H"),)),
            Panel("servicer axes [N]", (Curve("propulsion.F_S"),)),
        ),
    ),
    Figure(
        "tracking_error",
        "Position tracking error, Hill axes",
        (
            Panel("error [m]", (Curve("controller.e1_H"),)),
            Panel("|error| [m]", (Curve("controller.e1_H", convert=_norm),), log=True),
        ),
    ),
    Figure(
        "estimated_mass",
        "Estimated and true mass",
        (Panel("mass [kg]", (Curve("controller.m_hat", "estimate"), Curve("servicer.mass", "true", style="--"))),),
    ),
    Figure(
        "attitude_error",
        "Attitude error",
        (
            Panel("MRP of S relative to D", (Curve("controller.epsilon"),), after=ATTITUDE_START),
            Panel("angle [deg]", (Curve("controller.epsilon", convert=_mrp_angle),), after=ATTITUDE_START, log=True),
        ),
    ),
    Figure(
        "wheel_speeds",
        "Wheel speeds",
        (Panel("speed [rad/s]", (Curve("servicer.wheel_speed"),), after=ATTITUDE_START),),
    ),
    Figure(
        "inertia_estimates",
        "Estimated inertias",
        (
            Panel(
                "body [kg m2]",
                (Curve("controller.eta_hat", convert=lambda x: x[:, :6], labels=J_LABELS),),
                after=ATTITUDE_START,
            ),
            Panel(
                "wheels [kg m2]",
                (Curve("controller.eta_hat", convert=lambda x: x[:, 6:], labels=A_LABELS),),
                after=ATTITUDE_START,
            ),
        ),
    ),
    Figure(
        "alignment",
        "Alignment",
        (
            Panel(
                "angle [deg]",
                (
                    Curve("guidance.beta_t", "grasp axis to relative position", _degrees),
                    Curve("guidance.beta_p", "arm to direction of target", _degrees),
                ),
            ),
        ),
    ),
)


def plot(result: Result, directory: Path) -> list[Path]:
    """Draw every figure whose variables the result holds, as PNG in `directory`; returns the files written.

    Raises ResultsError if no figure fits or the directory cannot be written.
    """
    figures = [figure for figure in FIGURES if all(name in result for name in figure.variables())]
    approach = all(name in result for name in ("guidance.rho_H", "guidance.rho_ref_H"))
    if not figures and not approach:
        raise ResultsError("the result holds the variables of no known figure")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        paths = [_save(_approach(result), directory / "trajectory.png")] if approach else []
        return paths + [_save(_over_time(result, figure), directory / f"{figure.name}.png") for figure in figures]
    except OSError as error:
        raise ResultsError(f"{directory}: cannot be written: {error.strerror}") from error


def _new_figure(**options: Any) -> Any:
    """A figure of matplotlib without a window and without pyplot's global state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Canvas

    figure = Canvas(layout="constrained", **options)
    FigureCanvasAgg(figure)
    return figure


def _save(figure: Any, path: Path) -> Path:
    figure.savefig(path, dpi=110)
    return path


def _over_time(result: Result, figure: Figure) -> Any:
    canvas = _new_figure(figsize=(8, 1.2 + 2.6 * len(figure.panels)))
    canvas.suptitle(figure.title)
    for i, panel in enumerate(figure.panels, start=1):
        axes = canvas.add_subplot(len(figure.panels), 1, i)
        _draw_panel(axes, result, panel)
    return canvas


def _draw_panel(axes: Any, result: Result, panel: Panel) -> None:
    shown = result.time >= panel.after if result.time[-1] > panel.after else slice(None)
    time = result.time[shown]
    for curve in panel.curves:
        history = result[curve.variable][shown]
        _draw_curve(axes, time, curve.convert(history) if curve.convert else history, curve)
    axes.set(xlabel="time [s]", ylabel=panel.ylabel)
    if panel.log:
        axes.set_yscale("log")
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="best", fontsize="small", ncols=3)
    axes.grid(alpha=0.3)


def _draw_curve(axes: Any, time: Array, history: Array, curve: Curve) -> None:
    if history.ndim == 1:
        axes.plot(time, history, curve.style, label=curve.label or None)
        return
    for k in range(history.shape[1]):
        name = curve.labels[k] if k < len(curve.labels) else str(k + 1)
        axes.plot(time, history[:, k], curve.style, label=f"{curve.label} {name}".strip())


def _approach(result: Result) -> Any:
    """Path of the servicer about the target in Hill axes: in space, and seen along the orbit normal."""
    actual, reference = result["guidance.rho_H"], result["guidance.rho_ref_H"]
    canvas = _new_figure(figsize=(11, 5))
    canvas.suptitle("Approach trajectory, Hill frame of the target")
    space = canvas.add_subplot(1, 2, 1, projection="3d")
    plane = canvas.add_subplot(1, 2, 2)
    for path, style, label in ((actual, "-", "servicer"), (reference[1:], "--", "reference")):
        space.plot(*path.T, style, linewidth=1, label=label)
        plane.plot(path[:, 1], path[:, 0], style, linewidth=1, label=label)
    space.scatter(0, 0, 0, color="black", label="target")
    plane.plot(0, 0, "ko", label="target")
    plane.plot(actual[0, 1], actual[0, 0], "g^", label="start")
    space.set(xlabel="radial x [m]", ylabel="along track y [m]", zlabel="normal z [m]")
    plane.set(xlabel="along track y [m]", ylabel="radial x [m]", aspect="equal")
    plane.grid(alpha=0.3)
    plane.legend(fontsize="small")
    return canvas
