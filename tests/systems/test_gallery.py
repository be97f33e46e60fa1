# SPDX-License-Identifier: BSD-2-Clause
"""The gallery: its page shows the pictures of its scenes, and they stay small."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest
from matplotlib.image import imread

from tests.missions import FIGURES, OVERLAYS

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PICTURES = sorted((DOCS / "pictures").glob("*"))


@pytest.fixture(scope="module")
def gallery():
    spec = importlib.util.spec_from_file_location("gallery", ROOT / ".ci" / "gallery.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def shown(page):
    return re.findall(r"!\[[^]]+\]\(([^)]+)\)", page.read_text(encoding="utf-8"))


def test_the_page_shows_every_picture_of_every_scene(gallery):
    names = [f"pictures/{s.name}_{figure}.png" for s in gallery.SCENES for figure in s.figures]
    assert shown(DOCS / "gallery.md") == names
    assert sorted(names) == [f"pictures/{path.name}" for path in PICTURES]


def test_scenes_name_figures_that_there_are(gallery):
    for scene in gallery.SCENES:
        known = FIGURES if len(scene.runs) == 1 else OVERLAYS
        assert set(scene.figures) <= {figure.name for figure in known}, scene.name


def test_the_readme_is_one_screen_and_shows_one_of_them():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 60
    names = shown(ROOT / "README.md")
    assert len(names) == 1
    assert all((ROOT / name) in PICTURES for name in names)


def test_pictures_are_small_and_not_empty():
    assert sum(path.stat().st_size for path in PICTURES) < 1_500_000
    for path in PICTURES:
        assert path.stat().st_size < 150_000, path.name
        ink = imread(path)[..., :3].min(axis=2) < 0.9
        assert 0.003 < ink.mean() < 0.6, path.name


def test_a_scene_is_simulated_and_drawn_by_the_script(gallery):
    scene = next(scene for scene in gallery.SCENES if scene.name == "ppc")
    short = scene._replace(runs={"a": {"stop": 5.0}, "b": {"stop": 5.0, "params": "manoeuvre"}})
    png = gallery.drawn("compared_range", gallery.simulate(short))
    assert png.startswith(b"\x89PNG")
    assert len(png) < 150_000
