# SPDX-License-Identifier: BSD-2-Clause
"""Rewrite C files of FMUs as C++ for several runs in the lanes of vectors (core/lanes/lanes.h).

`c ? a : b` and `if (c) return a; rest` become calls that select a or b for each run, since the
condition c may differ between runs, and `if (c) f(x, y);` becomes a call that performs f for the
runs in which c holds. If the runs differ in c, both a and b are computed, so an expression that
writes is left as it is: the runs must then agree in c.
"""

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

TOKEN = re.compile(
    r"\s+|//[^\n]*|/\*.*?\*/|(?m:^[ \t]*\#(?:[^\\\n]|\\.)*)"
    r"|\"(?:[^\"\\]|\\.)*\"|'(?:[^'\\]|\\.)*'"
    r"|\d(?:[eEpP][+-]|[\w.])*|\.\d(?:[eE][+-]|\w)*|\w+"
    r"|<<=|>>=|->|\+\+|--|<<|>>|&&|\|\||[-+*/%&|^=!<>]=|.",
    re.DOTALL,
)
CLOSING = {"(": ")", "[": "]", "{": "}"}
ASSIGNMENTS = {"=", *(f"{c}=" for c in "+-*/%&|^"), "<<=", ">>="}
BEFORE = {*",;:", "return", "else", *ASSIGNMENTS}
"""Tokens after which an expression can begin."""
WRITING = {*ASSIGNMENTS, "++", "--"}
"""Operators of C that change a variable."""
WITHOUT_EFFECT = {"sizeof", "return", "copysign", "fabs", "isfinite", "isnan", "signbit", "sqrt"}
"""Words before a parenthesis that change no variable: keywords of C, functions of its library."""

OPERAND_ENDS = {"&&", "||", "?", ":", ",", ";"}
"""Tokens that end the right operand of `&&` and `||`."""
MADE = "made"
"""Name of the variable in the code that replaces a designated initializer: `made.a = 1;`."""
CONDITION = {"&&", "||", "<", ">", "<=", ">=", "==", "!="}
"""Operators whose value is a condition."""

TABLES = ("start", "variables")
"""Names of the tables of a model that in_lanes() leaves out, because a step does not use them."""
WORDS = {"class", "delete", "new", "operator", "private", "public", "template", "this", "typename"}
"""Keywords of C++ that may be names in C."""

Items = list[Any]
"""Parsed C text: a list of items, each a token, or a bracket with its content as a list [opening
bracket, item, ...].
"""


class Effects(NamedTuple):
    """Functions and macros of C files, by whether they may write.

    without: names of the functions and macros that write nothing but their own variables; macros:
    names of the macros that may write.
    """

    without: set[str]
    macros: set[str]


def parsed(text: str) -> Items:
    """Return a C text as items (tokens, and brackets with their content), without comments. A name
    of WORDS, the keywords of C++, gets the suffix `_`.
    """
    stack: list[Items] = [[]]
    for token in TOKEN.findall(text):
        if token in CLOSING:
            stack.append([token])
        elif token in CLOSING.values():
            group = stack.pop()
            stack[-1].append(group)
        elif token.lstrip().startswith("#"):
            stack[-1].append(f"\n{token}\n")
        elif not token.isspace() and not token.startswith(("//", "/*")):
            stack[-1].append(f"{token}_" if token in WORDS else token)
    return stack[0]


def written(items: Items) -> str:
    """Return parsed items (tokens and brackets with their content) as a C text again."""
    texts = (x if isinstance(x, str) else f"{x[0]}{written(x[1:])}{CLOSING[x[0]]}" for x in items)
    return " ".join(f"{text}\n" if text.endswith((";", "}")) else text for text in texts)


def is_block(item: Any) -> bool:
    """Return whether an item is a pair of braces with its content."""
    return isinstance(item, list) and item[0] == "{"


def conditionals(items: Items, effects: Effects) -> Items:
    """Return items in which a call of lanes::choose() replaces every `c ? a : b` whose a and b
    write nothing; in any other conditional expression, c is converted to bool, which must be the
    same in all lanes.
    """
    items = [x if isinstance(x, str) else [x[0], *conditionals(x[1:], effects)] for x in items]
    if "?" not in items:
        return items
    at = items.index("?")
    begin = max((i + 1 for i, x in enumerate(items[:at]) if is_block(x) or starts(x)), default=0)
    colon, inner = at + 1, 0
    while inner or items[colon] != ":":
        inner += {"?": 1, ":": -1}.get(str(items[colon]), 0)
        colon += 1
    end = next((i for i in range(colon, len(items)) if items[i] in (",", ";")), len(items))
    a = conditionals(items[at + 1 : colon], effects)
    b = conditionals(items[colon + 1 : end], effects)
    left, test, right = items[:begin], items[begin:at], conditionals(items[end:], effects)
    if may_write([*a, ";", *b], effects):
        return [*left, *as_bool(test), "?", *a, ":", *b, *right]
    both = [", [&]", ["{", "return", *a, ";"], ", [&]", ["{", "return", *b, ";"]]
    return [*left, "lanes::choose", ["(", *test, *both], *right]


def starts(item: Any) -> bool:
    """Return whether an expression can begin after an item."""
    return isinstance(item, str) and item in BEFORE


def as_bool(items: Items) -> Items:
    """Return the parsed C++ expression `(bool)(items)`, which converts `items` to bool."""
    return [["(", "bool"], ["(", *items]]


def early_returns(body: Items, kind: str, effects: Effects) -> Items:
    """Return the statements of a function in which a call of lanes::choose_as() replaces `if (c)
    return a; rest` whose a writes nothing; kind: the type that the function returns.
    """
    for i, item in enumerate(body[:-2]):
        if item == "if" and body[i + 2] == "return" and (i == 0 or ends(body[i - 1])):
            end = body.index(";", i)
            if end + 1 == len(body) or body[end + 1] == "else":
                return body
            rest = early_returns(body[end + 1 :], kind, effects)
            value, test = body[i + 3 : end], body[i + 1][1:]
            if may_write(value, effects):
                return [*body[: end + 1], *rest]
            function = f"[&]() -> {kind}"
            first = ["{", "return", *value, ";"]
            call = ["(", *test, ",", function, first, ",", function, ["{", *rest]]
            return [*body[:i], "return", f"lanes::choose_as<{kind}>", call, ";"]
    return body


def short_circuits(items: Items, effects: Effects) -> Items:
    """Return items in which a right operand of `&&` or `||` that may write is converted to bool:
    C++ then computes the operand only if the left operand, which must be the same in all lanes,
    does not decide the result.
    """
    found: Items = []
    left = [x if isinstance(x, str) else [x[0], *short_circuits(x[1:], effects)] for x in items]
    while left:
        item, left = left[0], left[1:]
        found.append(item)
        if item in ("&&", "||"):
            limits = (
                i
                for i, x in enumerate(left)
                if is_block(x) or (isinstance(x, str) and x in OPERAND_ENDS)
            )
            end = next(limits, len(left))
            right, left = left[:end], left[end:]
            found += as_bool(right) if may_write(right, effects) else right
    return found


def may_write(items: Items, effects: Effects) -> bool:
    """Return whether an expression may change a variable or what a pointer points to.

    Calls of functions and macros that are not in `effects.without` count as writing.
    """
    begin = 0
    for i, item in enumerate(items):
        if item in (";", ","):
            begin = i + 1
        elif is_unknown_call(items, i):
            return True
        elif isinstance(item, list):
            if may_write(item[1:], effects):
                return True
        elif items[i + 1 : i + 2] and items[i + 1][0] == "(":
            if is_name(item) and item not in effects.without:
                return True
        elif item in effects.macros or (item in WRITING and items[begin] != MADE):
            return True
    return False


def is_unknown_call(items: Items, i: int) -> bool:
    """Return whether item i holds the arguments of a call through a pointer: `x->f(...)`,
    `x.f(...)` or `(*f)(...)`.
    """
    if items[i][0] != "(" or not i:
        return False
    before = items[i - 1]
    if isinstance(before, list):
        return before[:2] == ["(", "*"]
    return before.isidentifier() and items[i - 2 : i - 1] in (["->"], ["."])


def ends(item: Any) -> bool:
    """Return whether an item is the end of a statement: a semicolon or a block in braces."""
    return item == ";" or is_block(item)


def designated(items: Items) -> Items:
    """Return items in which assignments replace designated initializers: of structs (`{.a = 1}`),
    which C++ permits only in the order of the declaration, and of arrays (`{[2] = 1}`), which it
    does not permit.
    """
    found: Items = []
    for item in items:
        if is_block(item) and item[1:2] == ["."]:
            found += ["lanes::Made", ["{", f"[&](auto &{MADE})", ["{", *assignments(MADE, item)]]]
        elif is_block(item) and item[1:2] and item[1][0] == "[" and found[-1] == "=":
            begin = max((i + 1 for i, x in enumerate(found) if ends(x)), default=0)
            plain = [x for x in found[begin:-1] if x not in ("static", "const")]
            found[begin:] = [*plain, "= {};", *assignments(found[-3], item)]
        elif isinstance(item, list):
            found.append([item[0], *designated(item[1:])])
        else:
            found.append(item)
    return found


def assignments(name: str, item: Items) -> Items:
    """Return assignments to the elements of the variable `name` that replace a designated
    initializer; item: the initializer in braces.
    """
    found: Items = []
    for part in separated(item[1:]):
        at = part.index("=")
        place, value = [name, *part[:at]], designated(part[at + 1 :])
        if is_block(value[0]):
            found += ["lanes::set", ["(", *place, ",", ["{", *value]], ";"]
        else:
            found += [*place, "=", *value, ";"]
    return found


def separated(items: Items, by: str = ",") -> list[Items]:
    """Return the lists of items between the tokens `by`, without empty lists."""
    parts: list[Items] = [[]]
    for item in items:
        if item == by:
            parts.append([])
        else:
            parts[-1].append(item)
    return [part for part in parts if part]


def with_casts(items: Items) -> Items:
    """Return items of a C text in which the initial value of a pointer declaration `T *a = b;` is
    cast to `T *`, which C++ requires if b is a `void *`.
    """
    found: Items = []
    for i, item in enumerate(items):
        found.append(item if isinstance(item, str) else [item[0], *with_casts(item[1:])])
        if item == "=" and items[i - 2 : i - 1] == ["*"] and items[i + 2 : i + 3] == [";"]:
            begin = max((k + 1 for k, x in enumerate(items[:i]) if ends(x)), default=0)
            kind = items[begin : i - 2]
            if kind and all(map(is_name, kind)) and not {"else", "do"} & set(kind):
                found.append(["(", *(x for x in kind if x != "static"), "*"])
    return found


def is_name(item: Any) -> bool:
    """Return whether an item is a word."""
    return isinstance(item, str) and item.isidentifier()


def definitions(items: Items) -> Iterator[tuple[int, int]]:
    """Yield two indices for each function in a parsed C file: the index of the first item of its
    head, and the index of its body.
    """
    begin = 0
    for i, item in enumerate(items):
        if is_block(item) and i and items[i - 1][:1] == ["("]:
            yield begin, i
        if ends(item) or is_directive(item):
            begin = i + 1


def is_directive(item: Any) -> bool:
    """Return whether an item is a directive of the preprocessor."""
    return isinstance(item, str) and item.startswith("\n")


def in_lanes(text: str, headers: Sequence[Items] = ()) -> str:
    """Return a C file rewritten as C++ that uses lanes.h, without the tables of start values and
    variables; headers: parsed files that it may include.
    """
    items = parsed(text)
    effects = effects_of([*headers, items])
    for begin, i in definitions(items):
        if "int" in items[begin:i] and is_condition(items[i][1:]):
            items[items.index("int", begin)] = "auto"
        items[i] = ["{", *function(items[begin:i], items[i][1:], effects)]
    begin = 0
    for i, item in enumerate(items):
        if is_block(item) and any(name in items[begin:i] for name in TABLES):
            items[begin : i + 1] = [""] * (i + 1 - begin)
        if ends(item) or is_directive(item):
            begin = i + 1
    return written(items)


def function(head: Items, body: Items, effects: Effects) -> Items:
    """Return the rewritten body of a function; head: the items in front of the body.

    The body of check() becomes empty, because lanes check no parameters. In a function that writes
    nothing and returns a value of another type than int and bool, early returns are rewritten, and
    a body with searches (see searches()) is run separately for lanes that differ in a condition.
    """
    head = [x for x in head if x not in ("static", "inline")]
    begin = max((k + 1 for k, x in enumerate(head[:-1]) if isinstance(x, list)), default=0)
    kind = " ".join(head[begin:-2])
    if head[-2] == "check":
        return []
    body = short_circuits(designated(with_casts(body)), effects)
    if kind in ("void", "int", "bool") or head[-2] not in effects.without:
        return statements(conditionals(body, effects))
    body = conditionals(early_returns(body, kind, effects), effects)
    if not searches(body):
        return body
    return ["return", f"lanes::apart<{kind}>", ["(", f"[=]() mutable -> {kind}", ["{", *body]], ";"]


def is_condition(body: Items) -> bool:
    """Return whether the body of a function is one statement that returns a condition."""
    top = [x for x in body if isinstance(x, str)]
    one = top[:1] == ["return"] and top.count(";") == 1 and "?" not in top
    return one and not CONDITION.isdisjoint(top)


def statements(items: Items) -> Items:
    """Return statements in which `if (c) f(x, y);` with arguments that contain no brackets is
    replaced by a call of lanes::where(), which performs f only in the lanes in which c holds.
    """
    found: Items = []
    left = items
    while left:
        match left[:6]:
            case ["if", ["(", *test], str(name), ["(", *given], ";", *after] if (
                name != "return" and after != ["else"] and all(isinstance(x, str) for x in given)
            ):
                function = ["[&]", ["{", name, ["(", *given], ";"]]
                found += ["lanes::where", ["(", *test, ",", *function, ",", *given], ";"]
                left = left[5:]
            case [item, *_]:
                found.append(item if isinstance(item, str) else [item[0], *statements(item[1:])])
                left = left[1:]
    return found


def searches(items: Items) -> bool:
    """Return whether statements contain a `while`, or both a `for` and an `if`: the number of
    passes of such a loop may differ between lanes.
    """
    words = set(tokens(written(items)))
    return "while" in words or {"for", "if"} <= words


def tokens(text: str) -> list[str]:
    """Return the tokens of a C text, without the tokens that are white space."""
    return [x for x in TOKEN.findall(text) if not x.isspace()]


MACRO = re.compile(r"\s*#\s*define\s+(\w+)(?:\([^)]*\))?(.*)", re.DOTALL)
"""Definition of a macro: its name and its replacement."""


def effects_of(files: Sequence[Items]) -> Effects:
    """Return the effects of the functions and macros of parsed C files. A function may write if it
    returns a pointer or has an argument through which it can write, and a macro if it assigns or
    calls such a function.
    """
    types = holding(files)
    functions = [(x[i - 2], x[begin:i]) for x in files for begin, i in definitions(x)]
    writing = {name for name, head in functions if writes(head, types)}
    macros: dict[str, Items] = {}
    for match in (MACRO.match(x) for items in files for x in items if is_directive(x)):
        if match:
            macros[match[1]] = [*macros.get(match[1], []), *tokens(match[2])]
    found = Effects({name for name, _ in functions} - writing | WITHOUT_EFFECT, set(macros))
    for _ in macros:  # repeated: a macro is found harmless after all macros in it are
        harmless = {name for name in found.macros if not may_write(macros[name], found)}
        if not harmless:
            break
        found.without.update(harmless)
        found.macros.difference_update(harmless)
    return found


class Types(NamedTuple):
    """Names of types.

    holders: types that are or contain a pointer through which one can write, and array types
    (because C passes an argument of an array type as a pointer); functions: types of functions that
    write through no argument.
    """

    holders: set[str]
    functions: set[str]


def holding(files: Sequence[Items]) -> Types:
    """Return the Types of parsed C files: names of the types that the files define."""
    defined = [each for items in files for each in type_definitions(items)]
    found = Types(set(), {name for name, _, function in defined if function})
    for _ in defined:  # repeated: a type is found after the type of its member that holds a pointer
        more = {n for n, parts, f in defined if any(holds(x, found, arrays=f) for x in parts)}
        if more <= found.holders:
            break
        found.holders.update(more)
        found.functions.difference_update(more)
    return found


def type_definitions(items: Items) -> Iterator[tuple[str, list[Items], bool]]:
    """Yield (name, parts, whether it is a type of functions) for each type that a parsed C file
    defines. Parts are the members of a struct or union, the arguments of a function, or for other
    types the declaration itself.
    """
    begin = 0
    for i, item in enumerate(items):
        body = is_block(item) and items[i - 1][:1] == ["("]
        if item != ";" and not is_directive(item) and not body:
            continue
        one, begin = items[begin:i], i + 1
        match one:
            case ["typedef", *_, str(name), ["(", *arguments]]:
                yield name, separated(arguments), True
            case ["typedef" | "struct" | "union", *_] if any(map(is_block, one)):
                at = next(k for k, x in enumerate(one) if is_block(x))
                for name in {*one[at - 1 : at], *one[at + 1 :]} - {"struct", "union", "enum"}:
                    yield name, separated(one[at][1:], ";"), False
            case ["typedef", *_]:
                name = next(x for x in reversed(tokens(written(one))) if is_name(x))
                yield name, [[*one[1:], "*"]] if one[-1][0] == "[" else [one[1:]], False


def holds(declaration: Items, types: Types, arrays: bool = False) -> bool:
    """Return whether a declared variable is or contains a pointer through which one can write.

    arrays: whether an array counts as a pointer, as in arguments.
    """
    words = [x for x in declaration if isinstance(x, str)]
    inside = [x for x in declaration if isinstance(x, list)]
    kind = words[: words.index("*")] if "*" in words else words
    if not types.functions.isdisjoint(kind):
        return False
    pointer = "*" in words or (arrays and any(x[0] == "[" for x in inside))
    return (
        (pointer and "const" not in kind)
        or words.count("*") > 1
        or not types.holders.isdisjoint(words)
        or any(x[:2] == ["(", "*"] for x in inside)
    )


def writes(head: Items, types: Types) -> bool:
    """Return whether a function can write through an argument, or returns a pointer."""
    arguments = separated(head[-1][1:])
    return "*" in head or any(holds(x, types, arrays=True) for x in arguments)
