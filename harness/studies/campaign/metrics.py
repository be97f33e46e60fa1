"""Numbers that a campaign keeps of every run: built-in measures, expressions, functions of the
user.

An expression names variables as the result does, `norm(servicer.r_SN_N - target.r_TN_N)[-1]`, and
knows the functions of FUNCTIONS and nothing else. A function is `FILE.py:NAME` and takes the
Result.
"""

from __future__ import annotations

import ast
import importlib.util
import operator
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.results.result import Result
from harness.spelling import did_you_mean
from harness.studies.measures import MEASURES, settling_time, steady_error

Array = NDArray[np.float64]
Metric = Callable[[Result], float]


def _norm(x: Array) -> Array:
    """Length of every row."""
    return np.asarray(np.linalg.norm(x, axis=-1))


def _total(x: Array) -> Array:
    """Sum over the elements of every row."""
    return np.asarray(np.sum(x, axis=-1))


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": np.abs,
    "cos": np.cos,
    "degrees": np.degrees,
    "exp": np.exp,
    "first": lambda x: x[0],
    "last": lambda x: x[-1],
    "log": np.log,
    "max": np.max,
    "mean": np.mean,
    "min": np.min,
    "norm": _norm,
    "percentile": np.percentile,
    "rms": lambda x: np.sqrt(np.mean(np.square(x))),
    "settling_time": settling_time,
    "sin": np.sin,
    "sqrt": np.sqrt,
    "std": np.std,
    "steady": steady_error,
    "total": _total,
}
"""Functions of an expression; `settling_time` and `steady` take time and error, as the measures."""

_BINARY: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.BitAnd: np.logical_and,
    ast.BitOr: np.logical_or,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_UNARY: dict[type[ast.AST], Callable[[Any], Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Invert: np.logical_not,
    ast.Not: np.logical_not,
}


def metric(text: str, folder: Path) -> Metric:
    """The metric that a text stands for; ValueError if it makes no sense.

    folder: where files of functions are looked for.
    """
    for measure in MEASURES:
        if measure.name == text:
            return measure
    file, colon, name = text.rpartition(":")
    if colon and file.endswith(".py"):
        return _function(folder / file, name)
    tree = _parsed(text)
    return lambda result: float(_evaluate(tree, lambda path: _history(result, path)))


def variables(text: str) -> Iterator[str]:
    """Variables that an expression names; none for a measure or a function."""
    if text in {m.name for m in MEASURES} or text.rpartition(":")[0].endswith(".py"):
        return
    found: list[str] = []
    _walk(_parsed(text), found)
    yield from (name for name in found if name != "time")


def _parsed(text: str) -> ast.expr:
    try:
        tree = ast.parse(text, mode="eval").body
    except SyntaxError as error:
        names = did_you_mean(text, [m.name for m in MEASURES])
        raise ValueError(f"there is no such measure, and it is no expression{names}") from error
    _walk(tree, [])
    return tree


def _walk(node: ast.expr, found: list[str]) -> None:
    """Collect variables; ValueError at whatever an expression may not hold."""
    if path := _path(node):
        if "." not in path and path != "time":
            raise ValueError(
                f"there is no such measure or variable: {path}"
                f"{did_you_mean(path, [*(m.name for m in MEASURES), 'time'])}"
            )
        found.append(path)
        return
    for part in _parts(node):
        _walk(part, found)


def _parts(node: ast.expr) -> list[ast.expr]:  # noqa: PLR0911 - one per kind
    """What an expression is made of, if it may be made of that."""
    match node:
        case ast.Constant(value=int() | float() | bool()):
            return []
        case ast.BinOp(left=a, op=op, right=b) if type(op) in _BINARY:
            return [a, b]
        case ast.Compare(left=a, ops=[op], comparators=[b]) if type(op) in _BINARY:
            return [a, b]
        case ast.UnaryOp(op=op, operand=a) if type(op) in _UNARY:
            return [a]
        case ast.BoolOp(values=values):
            return values
        case ast.Call(func=ast.Name(id="parameter"), args=[argument], keywords=[]):
            if not _path(argument):
                raise ValueError("parameter() wants component.name")
            return []
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            if name not in FUNCTIONS:
                raise ValueError(f"there is no function {name}{did_you_mean(name, FUNCTIONS)}")
            return arguments
        case ast.Subscript(value=a, slice=index):
            _index(index)
            return [a]
    raise ValueError(f"an expression cannot hold `{ast.unparse(node)}`")


def _path(node: ast.expr) -> str:
    """`guidance.los.elevation` of nested attributes, "" of anything else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        inner = _path(node.value)
        return f"{inner}.{node.attr}" if inner else ""
    return ""


def _index(node: ast.expr) -> Any:
    """Indices and slices of numbers, counted from 0 as in numpy."""
    match node:
        case ast.Tuple(elts=elements):
            return tuple(_index(e) for e in elements)
        case ast.Slice(lower=a, upper=b, step=c):
            return slice(*(None if x is None else _index(x) for x in (a, b, c)))
        case ast.Constant(value=int(number)):
            return number
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int(number))):
            return -number
    raise ValueError(f"an index must be a whole number, not `{ast.unparse(node)}`")


def _evaluate(node: ast.expr, look_up: Callable[[str], Any]) -> Any:  # noqa: PLR0911 - one per kind
    if path := _path(node):
        return look_up(path)
    match node:
        case ast.Constant(value=value):
            return value
        case ast.BinOp(left=a, op=op, right=b):
            return _BINARY[type(op)](_evaluate(a, look_up), _evaluate(b, look_up))
        case ast.Compare(left=a, ops=[op], comparators=[b]):
            return _BINARY[type(op)](_evaluate(a, look_up), _evaluate(b, look_up))
        case ast.UnaryOp(op=op, operand=a):
            return _UNARY[type(op)](_evaluate(a, look_up))
        case ast.BoolOp(op=op, values=values):
            parts = [_evaluate(v, look_up) for v in values]
            both = np.logical_and if isinstance(op, ast.And) else np.logical_or
            return both.reduce(parts)
        case ast.Call(func=ast.Name(id="parameter"), args=[argument]):
            return look_up(f"parameter {_path(argument)}")
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return FUNCTIONS[name](*(_evaluate(a, look_up) for a in arguments))
        case ast.Subscript(value=a, slice=index):
            return _evaluate(a, look_up)[_index(index)]
    raise AssertionError(ast.dump(node))


def _history(result: Result, path: str) -> Any:
    if path == "time":
        return result.time
    word, _, parameter = path.partition(" ")
    return result.parameter(parameter) if word == "parameter" else result[path]


def _function(file: Path, name: str) -> Metric:
    """A function of a file of the user."""
    if not file.is_file():
        raise ValueError(f"{file}: no such file")
    place = importlib.util.spec_from_file_location(file.stem, file)
    assert place is not None
    assert place.loader is not None
    module = importlib.util.module_from_spec(place)
    try:
        place.loader.exec_module(module)
    except Exception as error:
        raise ValueError(f"{file}: cannot be imported ({error})") from error
    if not callable(found := getattr(module, name, None)):
        raise ValueError(f"{file}: has no function {name}")
    return found  # type: ignore[no-any-return]


def measured(metrics: Mapping[str, Metric], result: Result) -> dict[str, float]:
    """All metrics of a run; NaN where one does not exist for it."""
    values = {}
    for name, each in metrics.items():
        try:
            values[name] = float(each(result))
        except (KeyError, ValueError, IndexError, ZeroDivisionError, TypeError):
            values[name] = float("nan")
    return values
