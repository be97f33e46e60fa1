# SPDX-License-Identifier: BSD-2-Clause
"""Equations in plain notation become mathematics, and nothing of them is lost."""

from __future__ import annotations

import html
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.each import Each, each

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted((ROOT / "fmus").glob("*/*.c"))
PAGES = sorted((ROOT / "ssp").glob("*/*.md"))
SHAPES = {
    "mfrac": "({0} / {1})",
    "msub": "{0}_{1}",
    "msup": "{0}^{1}",
    "msubsup": "{0}_{1}^{2}",
    "mover": "{0}{1}",
    "msqrt": "root({0})",
    "mspace": " ",
}


@pytest.fixture(scope="module")
def typeset(writer):
    return writer["models"].writer("typeset")


def linear(mathml):
    """MathML on one line, with the structure in letters."""

    def text(node):
        parts = [text(child) for child in node]
        if node.tag in {"mfrac", "msub", "msup", "msubsup", "mover"}:
            return SHAPES[node.tag].format(*parts)
        inner = (node.text or "") + "".join(parts)
        return SHAPES.get(node.tag, "{0}").format(inner)

    return text(ElementTree.fromstring(re.sub(r"&(?!amp;|lt;|gt;|quot;)\w+;", plain, mathml)))


def plain(entity):
    return html.unescape(entity[0])


@each(
    ("line", "shown"),
    [
        ("dv/dt = -mu r/r^3", "(dv / dt)=−μ (r / r^3)"),
        ("C_TN^T F_T / mass", "C_TN^T F_T/ mass"),
        ("rb x (J_T rb)", "r_b×(J_T r_b)"),
        ("x x y", "x×y"),
        ("A x = f(x)", "A x=f(x)"),
        ("l = rho.a, 2.5 e2 . (Psi + 1)", "l=ρ⋅a,2.5 e_2⋅(Ψ+1)"),
        ("dm_hat/dt", "(dm^ / dt)"),
        ("(1-s.s)/(1+s.s)^2 s~", "(1−s⋅s / (1+s⋅s)^2) s~"),
        ("|r x v|/r^2", "(|r×v| / r^2)"),
        ("-|v_T|, 2 |v_T|", "−|v_T|,2 |v_T|"),
        ("q_SN q_AN* (x) b", "q_SN q_AN^*⊗b"),
        ("omega_0' = h'_ff", "ω_0^′=h_ff^′"),
        ("[R]x h_w, k * max_step", "[R]_× h_w,k·max_step"),
        ("dq/sqrt(dq^2 + friction_rate^2)", "(dq / root(dq^2+friction_rate^2))"),
        ("sum_k Jw_k^T, max_i x_i", "∑_kJ_w,k^T,max_i x_i"),
        ("R_(i-1), z_0..2, A_w,ii", "R_i−1,z_0‥2,A_w,ii"),
        ("e^{-beta t} + 1e-3", "e^−β t+1e-3"),
        ("d2L/dt2, a/b/c", "(d^2L / dt^2),a/b/c"),
        ("a point in a spring-damper, a", "a point in a spring-damper,a"),
        ("0 <= x_i <= 1 -> +-2", "0≤x_i≤1→±2"),
    ],
)
def test_a_line_has_this_structure(typeset, line, shown):
    assert re.sub(" +", " ", linear(typeset.math(line))) == shown


@pytest.mark.parametrize("line", ["|a + b", "a $ b", "a } b", "x_"])
def test_a_line_in_another_notation_is_rejected(typeset, line):
    with pytest.raises(typeset.NotationError):
        typeset.math(line)


# ---- all equations of the project


def equations(path):
    """Lines of equations of a C file or a page."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".c":
        comment = re.match(r"/\*(.*?)\*/", text, re.DOTALL)[1]
        return [line[5:] for line in comment.splitlines() if line.startswith(" *   ")]
    outside = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    return [line[4:] for line in outside.splitlines() if line.startswith("    ")]


@pytest.fixture
def path():
    return Each([p for p in (*SOURCES, *PAGES) if equations(p)], lambda p: p.stem)


def letters(text, typeset):
    """Letters and digits, sorted, without x and o, which may be signs."""
    for name, sign in typeset.GREEK.items():
        text = re.sub(rf"(?<![A-Za-z])(d{{0,2}}){name}(?![a-z])", rf"\1{plain([sign])}", text)
    return sorted(re.sub(r"[\W_xo]", "", text))


SIGNS = re.compile(r"_hat|\bsqrt\b|(?<![A-Za-z_])(sum|integral|grad)(?![a-z])")


def test_every_equation_is_in_the_notation_and_nothing_is_lost(path, typeset):
    for line in equations(path):
        assert not line.startswith("harness "), "commands belong in fences (```sh)"
        shown = html.unescape(" ".join(re.findall(r">([^<]*)<", typeset.block([line]))))
        assert letters(shown, typeset) == letters(SIGNS.sub("", line), typeset), line


def test_a_comment_in_another_notation_stays_as_it_is(writer):
    package = writer["models"].writer("package_fmu")
    assert package.equations("x.c - law\n\n   a = $b < c") == (
        "<pre>x.c - law\n\n   a = $b &lt; c</pre>"
    )


def test_a_page_of_a_mission_has_equations_beside_its_code(writer):
    page = writer["missions"].typeset(
        "Law:\n\n    F = m a\n\n```sh\nharness run x\n    -o y\n```\n"
    )
    assert "```sh\nharness run x\n    -o y\n```" in page
    assert page.count("<math") == 1
