# SPDX-License-Identifier: BSD-2-Clause
"""Drawing of paths in space to scale, in perspective and seen along one axis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from harness.mission.figure import Axes, Colour
from harness.results.result import Array

SHORTEST = 0.35
"""Smallest ratio of the length of an axis to the longest one in the perspective view."""


def draw_paths(
    canvas: Axes,
    paths: Mapping[str, tuple[Array, str]],
    names: tuple[str, str, str],
    plane: tuple[int, int],
    colours: Mapping[str, Colour] | None = None,
) -> Axes:
    """Draw paths in perspective and in one plane, both to scale; return the axes of the plane.

    paths: positions (rows, 3) and style of matplotlib by label; names: axis labels of the three
    coordinates; plane: indices of the horizontal and vertical coordinate of the plane; colours: by
    label (None: chosen by matplotlib).
    """
    from matplotlib import rcParams

    space = canvas.add_subplot(1, 2, 1, projection="3d")
    flat = canvas.add_subplot(1, 2, 2)
    dashes = rcParams["axes.prop_cycle"].by_key().get("linestyle", ["-"])
    for k, (label, (path, style)) in enumerate(paths.items()):
        look = {"linewidth": 1, "label": label}
        look |= {"color": colours[label]} if colours and label in colours else {}
        look |= {"linestyle": dashes[k % len(dashes)]} if style == "-" else {}
        given = () if style == "-" else (style,)
        space.plot(*path.T, *given, **look)
        flat.plot(path[:, plane[0]], path[:, plane[1]], *given, **look)
    space.set(xlabel=names[0], ylabel=names[1], zlabel=names[2])
    _to_scale(space)
    flat.set(xlabel=names[plane[0]], ylabel=names[plane[1]])
    flat.set_aspect("equal", adjustable="datalim")
    return flat


def _to_scale(space: Axes) -> None:
    """Set the same scale and the same ticks along all three axes, none of them so short that its
    labels overlap.
    """
    from matplotlib.ticker import MaxNLocator, MultipleLocator

    limits = space.xy_viewLim.intervalx, space.xy_viewLim.intervaly, space.zz_viewLim.intervalx
    longest = max(limits, key=np.ptp)
    step = float(np.diff(MaxNLocator(4).tick_values(*longest))[0])
    axes = (space.xaxis, space.yaxis, space.zaxis)
    for axis, (low, high) in zip(axes, limits, strict=True):
        middle, half = (low + high) / 2, max(high - low, SHORTEST * np.ptp(longest)) / 2
        space.set(**{f"{axis.axis_name}lim": (middle - half, middle + half)})
        axis.set_major_locator(MultipleLocator(step))
    space.set_aspect("equal", adjustable="box")
    space.tick_params(pad=0)
