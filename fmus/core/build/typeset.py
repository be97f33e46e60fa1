# SPDX-License-Identifier: BSD-2-Clause
"""Typesetting in MathML of the plain equations in comments of C files and pages of missions.

    dv/dt = -mu r/r^3 + C_TN^T F_T / mass,    M_gg = 3 mu/r^3 rb x (J_T rb)

alpha .. Omega are Greek; `_` begins subscripts, `^` a superscript; `_hat` a hat, `s~` a tilde, `q*`
a star, `h'` a prime. `a/b` without blanks is a fraction, ` / ` stays in the line; ` x ` between two
operands is the vector product, `.` the scalar one, `[R]x` the matrix of a vector product. ` (x) `
is the Kronecker product or the product of quaternions, ` (o) ` the product element by element,
` * ` any other product.
`|a|`, `sqrt(...)`, `sum_k`, `integral` become symbols. Names of three letters and more are upright:
functions, parameters, words. Two or more blanks remain a gap, and line breaks remain.
"""

import html
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

LETTERS = (
    "alpha beta gamma delta epsilon zeta eta theta kappa lambda mu nu xi pi rho sigma tau phi chi "
    "psi omega Gamma Delta Lambda Sigma Phi Psi Omega"
)
GREEK = {name: f"&{name};" for name in LETTERS.split()}
GREEK |= {"bet": "&beta;", "eps": "&epsilon;", "lam": "&lambda;"}
LARGE = {"sum": "&sum;", "integral": "&int;", "grad": "&nabla;"}
OPERATORS = {
    "(x)": "&otimes;", "(o)": "&odot;", "<=": "&le;", ">=": "&ge;", "->": "&rarr;",
    "<-": "&larr;", "+-": "&plusmn;", "+=": "+=", "-=": "&minus;=", "*=": "&middot;=",
    ">>": "&Gt;", "...": "&hellip;", "..": "&nldr;", "-": "&minus;", "*": "&middot;", "&": "&amp;",
    "<": "&lt;", ">": "&gt;", '"': "&quot;", **{each: each for each in "+=/,;:.?!%"},
}  # fmt: skip
CLOSING = {"(": ")", "[": "]", "{": "}", "|": "|"}
WORDS = {*"th of if in is at by to on or as no be an up so".split()}  # noqa: SIM905
"""Names of two letters that are upright words; other such names are a letter with a subscript, a
differential such as `dx`, or Greek.
"""

SLASH = "<mo>/</mo>"
NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
BELOW = re.compile(r"_(\((?:[^()]*)\)|[A-Za-z0-9]+(?:,[a-z]+(?![\w(]))?(?:\.\.\d+)?)")
ABOVE = re.compile(r"\^(\((?:[^()]*)\)|\{(?:[^{}]*)\}|-?[A-Za-z0-9]+|\+)")
CORE = re.compile(rf"(d{{0,2}})({'|'.join(sorted(GREEK, key=len, reverse=True))}|[A-Za-z])(\d\w*)?")
NUMBERED = re.compile(r" {2,}(\(\d+\)(?:, \(\d+\))*)$")


class NotationError(ValueError):
    """Error: a line of equations is not in the notation that this module describes."""


@dataclass
class Node:
    """Part of a line of equations as MathML.

    kind: operand, word, operator, space or gap, which determines the space between it and its
    neighbours; inside: MathML between the parentheses of a group.
    """

    kind: str
    text: str
    inside: str = ""


def block(lines: Iterable[str]) -> str:
    """Return the HTML of consecutive lines of equations; raise NotationError with the first line
    that is not in the notation.
    """
    return f'<div class="equations">{"".join(map(_row, lines))}</div>'


def page(text: str, indent: int) -> str:
    """Return the HTML of a comment: lines with at least `indent` leading blanks are equations."""
    parts = []
    for paragraph in re.split(r"\n\s*\n", text.strip("\n")):
        for equations, lines in _runs(paragraph.splitlines(), indent):
            words = html.escape(" ".join(line.strip() for line in lines))
            parts.append(block(line[indent:] for line in lines) if equations else f"<p>{words}</p>")
    return "\n".join(parts)


def _runs(lines: list[str], indent: int) -> Iterator[tuple[bool, list[str]]]:
    run: list[str] = []
    for line in lines:
        if run and line.startswith(" " * indent) != run[0].startswith(" " * indent):
            yield run[0].startswith(" " * indent), run
            run = []
        run.append(line)
    if run:
        yield run[0].startswith(" " * indent), run


def _row(line: str) -> str:
    number = NUMBERED.search(" " * 2 + line)
    shown = f'<span class="number">{number[1]}</span>' if number else ""
    text = line.rstrip()[: -len(number[1])].rstrip() if number else line.rstrip()
    return f"<div>{shown}{math(text)}</div>"


def math(line: str) -> str:
    """Return the MathML of one line; raise NotationError if the line is not in the notation."""
    nodes, end = Reader(line).sequence("")
    if end != len(line):
        raise NotationError(f"{line.strip()!r}: {line[end]!r} closes nothing")
    plain = html.escape(" ".join(line.split()))
    return f'<math displaystyle="true" alttext="{plain}"><mrow>{_written(nodes)}</mrow></math>'


class Reader:
    """Parser of one line of equations, from left to right."""

    article = re.compile(r"[a-z] a [a-z]{3}")

    def __init__(self, line: str) -> None:
        self.line = line
        self.at = 0

    def sequence(self, closing: str) -> tuple[list[Node], int]:
        """Read and return the nodes in front of the next closing bracket, or up to the end of the
        line if `closing` is "", and return the position behind them. The bracket is not read.
        """
        nodes: list[Node] = []
        while self.at < len(self.line):
            if closing and self.line[self.at] == closing and not self._opens(closing, nodes):
                break
            if self.line[self.at] in ")]}":
                if closing or self.line[self.at] == "}":
                    break
                # a bracket that was opened in an earlier line
                nodes.append(Node("operator", _fence(self.line[self.at])))
                self.at += 1
                continue
            nodes.append(self.node(nodes))
        return _fractions(nodes), self.at

    def _opens(self, bar: str, before: list[Node]) -> bool:
        """Return whether the next character, `bar`, is a `|` that begins and does not end a norm;
        before: the nodes already read.
        """
        if bar != "|":
            return False
        last = before[-1].kind if before else "operator"
        if last in {"space", "gap"}:
            return self.line[self.at + 1 : self.at + 2].strip() != "" and (
                len(before) < 2 or before[-2].kind != "operand" or last == "space"
            )
        return last in {"operator", "word"}

    def node(self, before: list[Node]) -> Node:
        """Read and return the next node; before: the nodes already read."""
        rest = self.line[self.at :]
        if blanks := re.match(" +", rest):
            self.at += blanks.end()
            long = blanks.end() > 1
            return Node("gap" if long else "space", _space(0.55 * blanks.end()) if long else "")
        if found := NUMBER.match(rest):
            self.at += found.end()
            return self._scripts(Node("operand", f"<mn>{found[0]}</mn>"))
        if rest[0] in "([{|" and not rest.startswith(("(x) ", "(o) ")):
            return self._group(rest[0])
        if (found := NAME.match(rest)) and not self._is_cross(before, rest):
            return self._name(found[0])
        return self._operator(before, rest)

    def _is_cross(self, before: list[Node], rest: str) -> bool:
        return (
            rest.startswith("x ")
            and len(before) > 1
            and before[-1].kind == "space"
            and before[-2].kind == "operand"
            and re.match(r"x [A-Za-z0-9(\[|]", rest) is not None
        )

    def _operator(self, before: list[Node], rest: str) -> Node:
        if rest.startswith("x "):
            self.at += 1
            return Node("operator", "<mo>&times;</mo>")
        if rest.startswith(": "):
            self.at += 1
            return Node("word", "<mtext>:</mtext>")
        for sign, shown in OPERATORS.items():
            if rest.startswith(sign):
                self.at += len(sign)
                return Node("operator", self._mark(sign, shown, before))
        raise NotationError(
            f"{self.line.strip()!r}: {rest[0]!r} is not in the notation that typeset.py describes"
        )

    def _mark(self, sign: str, shown: str, before: list[Node]) -> str:
        following = self.line[self.at : self.at + 2]
        last = next((n for n in reversed(before) if n.kind != "space"), Node("operator", ""))
        if (
            sign == "-"
            and last.kind == "word"
            and before[-1].kind == "word"
            and following[:1] > " "
        ):
            return "<mtext>-</mtext>"
        if sign == "." and last.kind == "operand" and re.match(r" ?[A-Za-z(\[|]", following):
            return "<mo>&sdot;</mo>"
        if sign in {".", "?", "!", "%", ":", '"'}:
            return f"<mtext>{shown}</mtext>"
        apart = bool(before) and before[-1].kind == "space" and following[:1] == " "
        prefix = sign in {"-", "+", "+-"} and last.kind in {"operator", "gap", "word"} and not apart
        return f'<mo form="prefix">{shown}</mo>' if prefix else f"<mo>{shown}</mo>"

    def _group(self, opening: str) -> Node:
        start, self.at = self.at, self.at + 1
        nodes, _ = self.sequence(CLOSING[opening])
        if self.line[self.at : self.at + 1] != CLOSING[opening]:
            if opening in "|{" or self.at < len(self.line):
                raise NotationError(f"{self.line.strip()!r}: {opening!r} is not closed")
            # the bracket is closed in a later line
            return Node("operator", _fence(opening) + _written(nodes))
        self.at += 1
        inside = _written(nodes)
        shown = f"<mrow>{_fence(opening)}{inside}{_fence(CLOSING[opening])}</mrow>"
        plain = inside if opening == "(" else ""
        if re.match(r"x(?!\w)", self.line[self.at :]) and self.line[start] == "[":
            self.at += 1
            return self._scripts(Node("operand", f"<msub>{shown}<mo>&times;</mo></msub>"))
        return self._scripts(Node("operand", shown, plain))

    def _name(self, name: str) -> Node:
        self.at += len(name)
        if name in LARGE:
            return self._scripts(Node("operator", f"<mo>{LARGE[name]}</mo>"))
        if name == "a" and self.article.match(self.line, self.at - 3):
            return Node("word", "<mtext>a</mtext>")
        short = CORE.fullmatch(name)
        if name in WORDS or (not short and len(name) > 2 and name != "wdd"):
            return self._upright(name)
        return self._applied(self._symbol(name, short), name)

    def _upright(self, name: str) -> Node:
        """Read the rest of a word or long name and return its node. A subscript of several
        letters is not lowered: the node shows `rate_max` as it is written.
        """
        shown, rest = f"<mi>{name}</mi>", self.line[self.at :]
        subscript = re.match(r"(?:_[A-Za-z0-9]+)+", rest)
        if subscript and subscript[0] == "_hat":
            self.at += subscript.end()
            shown = _over(shown, "^")
        elif subscript and not re.fullmatch(r"_(\w|\d+)", subscript[0]):
            self.at += subscript.end()
            shown = f"<mi>{name}{subscript[0]}</mi>"
        elif not re.match(r"[_(^~]|'[^s]", rest):
            return Node("word", f"<mtext>{name}</mtext>")
        return self._applied(Node("operand", shown), name)

    def _symbol(self, name: str, short: re.Match[str] | None) -> Node:
        """Return the node of a Latin or Greek letter with its subscripts, hat and tilde, which are
        read from the line. A `d` in front of the letter, as in `dx`, is upright (differential).
        short: match of `name` with the expression CORE, None if it does not match.
        """
        if derivative := re.fullmatch(r"d(?:(\d)([A-Za-z])|([a-z])(\d))", name):  # d2L/dt2
            d, letter = "<mi mathvariant='normal'>d</mi>", derivative[2] or derivative[3]
            power = f"<mn>{derivative[1] or derivative[4]}</mn>"
            shown = f"<msup>{d}{power}</msup><mi>{letter}</mi>"
            if derivative[4]:
                shown = f"{d}<msup><mi>{letter}</mi>{power}</msup>"
            return Node("operand", f"<mrow>{shown}</mrow>")
        prefix, core, index = short.groups() if short else ("", name[0], name[1:])
        base = f"<mi>{GREEK.get(core, core)}</mi>"
        below: list[str] = [index] if index else []
        while (more := BELOW.match(self.line[self.at :])) and more[1] != "hat":
            below.append(more[1].strip("()"))
            self.at += more.end()
        if self.line.startswith("_hat", self.at):
            base = _over(base, "^")
            self.at += len("_hat")
        if self.line.startswith("~", self.at):
            self.at += 1
            base = _over(base, "~")
        shown = self._scripts(Node("operand", base), below).text
        d = "<mi mathvariant='normal'>d</mi>" * len(prefix)
        return Node("operand", f"<mrow>{d}{shown}</mrow>" if d else shown)

    def _applied(self, node: Node, name: str) -> Node:
        """Read the sub- and superscripts of a name and the arguments in parentheses after it, and
        return its node.
        """
        node = self._scripts(node)
        if self.line[self.at : self.at + 1] != "(":
            return node
        group = self._group("(")
        if group.kind != "operand":
            return Node("operator", node.text + group.text)
        if name == "sqrt" and group.inside:
            return Node("operand", f"<msqrt>{group.inside}</msqrt>")
        return Node("operand", f"<mrow>{node.text}{group.text}</mrow>")

    def _scripts(self, node: Node, below: Iterable[str] = ()) -> Node:
        below, above = list(below), ""
        while True:
            rest = self.line[self.at :]
            if found := re.match("'+", rest):
                above += f"<mo>{'&prime;' * found.end()}</mo>"
            elif found := ABOVE.match(rest):
                above += _above(found[1])
            elif (found := re.match(r"\*(?![\w(=])", rest)) and node.kind == "operand":
                above += "<mo>*</mo>"
            elif found := BELOW.match(rest):
                below.append(found[1].strip("()"))
            elif found := re.match("~", rest):
                node = Node("operand", _over(node.text, "~"))
            else:
                break
            self.at += found.end()
        if not below and not above:
            return node
        under, over = _below(below) if below else "", f"<mrow>{above}</mrow>"
        tag = "msubsup" if below and above else "msub" if below else "msup"
        return Node(node.kind, f"<{tag}>{node.text}{under}{over if above else ''}</{tag}>")


def _below(parts: list[str]) -> str:
    shown = []
    for part in ",".join(parts).split(","):
        shown.append(_inner(part))
    return f"<mrow>{'<mo>,</mo>'.join(shown)}</mrow>"


def _inner(text: str) -> str:
    """Return the MathML of a subscript: letters of frames, numbers, Greek names, `i-1`, `0..2`."""
    if text in GREEK or text.removeprefix("d") in GREEK:
        d = "" if text in GREEK else "<mi mathvariant='normal'>d</mi>"
        return f"{d}<mi>{GREEK[text.removeprefix('d') if d else text]}</mi>"
    if text.isalnum():
        return f"<mn>{text}</mn>" if text.isdigit() else f"<mi>{text}</mi>"
    nodes, end = Reader(text).sequence("")
    if end != len(text):
        raise NotationError(f"{text!r}: not a subscript")
    return _written(nodes)


def _above(text: str) -> str:
    """Return the MathML of a superscript."""
    if text == "+":
        return "<mo>+</mo>"
    if text[0] == "-":
        return f"<mo>&minus;</mo>{_inner(text[1:])}"
    return _inner(text.strip("(){}"))


def _fence(sign: str) -> str:
    return f'<mo stretchy="false">{sign}</mo>'


def _over(base: str, sign: str) -> str:
    return f"<mover>{base}<mo stretchy='false'>{sign}</mo></mover>"


def _space(width: float) -> str:
    return f'<mspace width="{width:.3g}em"/>'


def _fractions(nodes: list[Node]) -> list[Node]:
    """Return the nodes with every `a/b` as a fraction. A chain a/b/c remains in the line."""
    done: list[Node] = []
    while nodes:
        above, below = nodes[0], nodes[2] if len(nodes) > 2 else nodes[0]
        beside = [node.text for node in (*done[-1:], *nodes[3:4])]
        found = [node.text == SLASH for node in nodes[:3]] == [False, True, False]
        if found and above.kind == below.kind == "operand" and SLASH not in beside:
            parts = (f"<mrow>{node.inside or node.text}</mrow>" for node in (above, below))
            done.append(Node("operand", f"<mfrac>{''.join(parts)}</mfrac>"))
            nodes = nodes[3:]
        else:
            done.append(nodes[0])
            nodes = nodes[1:]
    return done


def _written(nodes: list[Node]) -> str:
    """Return the MathML of nodes, with blanks around words and thin spaces between operands."""
    parts = []
    for i, node in enumerate(nodes):
        if node.kind != "space":
            parts.append(node.text)
            continue
        around = {nodes[i - 1].kind if i else "", nodes[i + 1].kind if i + 1 < len(nodes) else ""}
        parts.append(
            _space(0.3) if "word" in around else _space(0.17) if around == {"operand"} else ""
        )
    return "".join(parts)
