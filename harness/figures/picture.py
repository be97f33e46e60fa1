# SPDX-License-Identifier: BSD-2-Clause
"""Image of the bodies of a scene at its last instant, which environments render."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.results.histories import turned
from harness.results.result import Array

FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:red")
SIZE = 4.8
"""Edge length of the image [inch], at 100 pixels per inch."""


def picture(scene: Mapping[str, Any], take: Callable[[str], Any], title: str) -> NDArray[np.uint8]:
    """Return an image (height, width, 3) of the bodies of a scene and their paths, relative to the
    origin of the scene; take: function that returns an array of the scene by its name.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    figure = Figure((SIZE, SIZE), dpi=100)
    canvas: Any = FigureCanvasAgg(figure)
    axes: Any = figure.add_subplot(projection="3d")
    reach = 1.0
    for body in scene["bodies"]:
        path, q = np.atleast_2d(take(body["r"])), np.atleast_2d(take(body["q"]))[-1]
        colour = COLOURS[body["colour"] % len(COLOURS)]
        faces = [turned(np.tile(q, (4, 1)), f) + path[-1] for f in _faces(body["parts"])]
        axes.add_collection3d(Poly3DCollection(faces, alpha=0.6, facecolor=colour, edgecolor="k"))
        axes.plot(*path.T, color=colour)
        reach = max(reach, float(np.abs(path[-1]).max()) + body["radius"])
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(-reach, reach), title=title)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _faces(parts: list[dict[str, Any]]) -> Iterator[Array]:
    """Yield the corners (4, 3) of the faces of all parts of a body [m]. A part that is not a box is
    drawn as the box around it.
    """
    for part in parts:
        begin, end = (np.asarray(part.get(n, part.get("at", (0, 0, 0)))) for n in ("from", "to"))
        half = np.asarray(part.get("size", 2 * [part.get("radius", 0.1)] * 3)[:3]) / 2
        if part["kind"] != "box":
            half = (np.abs(end - begin) / 2).clip(float(part.get("radius", 0.05) or 0.05))
        corners = (begin + end) / 2 + half * np.array(list(product((-1, 1), repeat=3)))
        yield from (corners[list(face)] for face in FACES)
