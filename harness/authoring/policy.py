# SPDX-License-Identifier: BSD-2-Clause
"""Learned policy as flight software: a neural network with the ports of a component, written as C99
with its weights as constants.

A policy is an .npz file of Policy.save(), or an .onnx file of another tool. The metadata entry
`ports` of an .onnx file describes its ports by the same JSON text as the array `ports` of an .npz
file. `harness build` builds an FMU from either.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.authoring.new import filled
from harness.errors import UsageError
from harness.results.result import Array

ACTIVATIONS: Mapping[str, tuple[Callable[[Array], Array], str]] = {
    "tanh": (np.tanh, "hyperbolic_tangent(x)"),
    "relu": (lambda x: np.maximum(x, 0.0), "larger(x, 0)"),
}
"""Activation functions by name: a Python function, and an expression of x in C."""
SIGNS = dict(zip(("Gemm", "MatMul", "Add", "Tanh", "Relu"), "LL+TR", strict=True))
SIGNS |= dict.fromkeys(("Identity", "Flatten", "Cast"), "")
"""Operators of .onnx files, each with its letter in the order of a policy: layer, +, activation."""


@dataclass(frozen=True)
class Ports:
    """Ports of a policy.

    inputs, outputs: name, unit and number of elements of each port; sizes: divisor of each observed
    element; low, high: bounds of each commanded element; scaled: whether the network gives values
    from -1 to 1, which are scaled to these bounds; starts: name, unit and start values of each
    output until the first sample (an output that the network does not command always has its start
    values); period: time between two samples [s].
    """

    inputs: Sequence[tuple[str, str, int]]
    outputs: Sequence[tuple[str, str, int]]
    sizes: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]
    scaled: bool
    starts: Sequence[tuple[str, str, Sequence[float]]]
    period: float


@dataclass(frozen=True)
class Policy:
    """Neural network of layers x -> W x + b, given as pairs (W, b), with an activation function
    between two layers.
    """

    ports: Ports
    layers: Sequence[tuple[Array, Array]]
    activation: str = "tanh"

    def __post_init__(self) -> None:
        width = len(self.ports.sizes)
        for i, (w, b) in enumerate(self.layers):
            if np.shape(w) != (len(b), width):
                shape = f"({len(b)}, {width})"
                raise UsageError(f"layer {i + 1}: expected weights {shape}, got {np.shape(w)}")
            width = len(b)
        if width != len(self.ports.low):
            commanded = len(self.ports.low)
            raise UsageError(f"the last layer has {width} outputs for {commanded} commanded values")
        if self.activation not in ACTIVATIONS:
            raise UsageError(f"activation {self.activation}: expected {' or '.join(ACTIVATIONS)}")

    def __call__(self, observation: Array) -> Array:
        """Return the action for an observation that is already divided by `ports.sizes`. The action
        is clipped to -1 .. 1 if `ports.scaled`, else to `ports.low` .. `ports.high`.
        """
        x = np.asarray(observation, dtype=np.float64)
        function, _ = ACTIVATIONS[self.activation]
        for i, (w, b) in enumerate(self.layers):
            x = w @ (x if i == 0 else function(x)) + b
        p = self.ports
        ends = (-1.0, 1.0) if p.scaled else (np.asarray(p.low), np.asarray(p.high))
        return np.clip(x, *ends)

    def save(self, path: str | Path) -> None:
        """Write the policy to a file .npz."""
        arrays = {f"{n}_{i}": x for i, pair in enumerate(self.layers)
                  for n, x in zip("Wb", pair, strict=True)}  # fmt: skip
        about = {"ports": json.dumps(asdict(self.ports)), "activation": self.activation}
        with Path(path).open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays, **about)

    # ---- C

    def source(self, name: str) -> str:
        """Return the C source of an FMU with this name that evaluates the policy."""
        p = self.ports
        rows = [f'    INPUT({n}, "{u}", "observed"),' for n, u, _ in p.inputs]
        rows += [f'    OUTPUT({n}, "{u}", "commanded"),' for n, u, _ in p.outputs]
        commanded = {name for name, _, _ in p.outputs}
        held = [(n, u, len(x)) for n, u, x in p.starts if n not in commanded]
        rows += [f'    OUTPUT({n}, "{u}", "constant"),' for n, u, _ in held]
        sizes = [(len(b), np.shape(w)[1]) for w, b in self.layers]
        return filled(
            "policy.c",
            name=name,
            inputs=_members(p.inputs),
            outputs=_members([*p.outputs, *held]),
            starts="".join(f"    .y.{n} = {_c(x)},\n" for n, _, x in p.starts),
            rows="\n".join(rows),
            period=repr(p.period),
            width=max(max(pair) for pair in sizes),
            size=_c(p.sizes),
            low=_c(p.low),
            high=_c(p.high),
            scaled=int(p.scaled),
            activation=ACTIVATIONS[self.activation][1],
            weights="\n".join(
                f"static const double {n}_{i}[] = {_c(np.ravel(x))};"
                for i, pair in enumerate(self.layers)
                for n, x in zip("Wb", pair, strict=True)
            ),
            layers="\n".join(
                f"    layer(W_{i}, b_{i}, {rows}, {columns}, {int(i > 0)}, x);"
                for i, (rows, columns) in enumerate(sizes)
            ),
            reads=_copies("u->", p.inputs, "x[{i}] = {port} / size[{i}];"),
            writes=_copies("y->", p.outputs, "{port} = command(x, {i});"),
        )


def _c(values: Any) -> str:
    """Return numbers as an initializer of a C array, eight per line."""
    numbers = [repr(float(x)) for x in values]
    lines = (", ".join(numbers[i : i + 8]) for i in range(0, len(numbers), 8))
    return "{" + ",\n    ".join(lines) + "}"


def _members(ports: Sequence[tuple[str, str, int]]) -> str:
    return "\n".join(f"    double {name}{f'[{n}]' if n > 1 else ''};" for name, _, n in ports)


def _copies(head: str, ports: Sequence[tuple[str, str, int]], line: str) -> str:
    elements = [
        f"{head}{name}{f'[{k}]' if n > 1 else ''}" for name, _, n in ports for k in range(n)
    ]
    return "\n".join("    " + line.format(i=i, port=port) for i, port in enumerate(elements))


# ---- files


def read(path: Path) -> Policy:
    """Return the policy in an .npz or .onnx file; raise UsageError if the file is no policy."""
    try:
        return _onnx(path) if path.suffix == ".onnx" else _npz(path)
    except ImportError as error:
        raise UsageError(f"{path}: needs the package onnx: pip install onnx") from error
    except Exception as error:  # numpy, zipfile and onnx raise many kinds for a damaged file
        raise UsageError(f"{path}: is not a policy ({error})") from error


def _npz(path: Path) -> Policy:
    with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
        count = sum(name.startswith("W_") for name in file)
        layers = [(file[f"W_{i}"], file[f"b_{i}"]) for i in range(count)]
        return Policy(Ports(**json.loads(str(file["ports"]))), layers, str(file["activation"]))


def _onnx(path: Path) -> Policy:
    """Return the policy in an .onnx file; raise ValueError for a graph other than a chain of layers
    (Gemm, or MatMul and Add) with the same activation between any two and none after the last.
    """
    import onnx
    from onnx import numpy_helper

    model = onnx.load(path)
    about = {entry.key: entry.value for entry in model.metadata_props}
    arrays = {x.name: numpy_helper.to_array(x).astype(np.float64) for x in model.graph.initializer}
    layers: list[tuple[Array, Array]] = []
    here, order = next(x.name for x in model.graph.input if x.name not in arrays), ""
    for node in model.graph.node:
        op, given = node.op_type, [arrays[name] for name in node.input if name in arrays]
        flags = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
        plain = flags.get("alpha", 1) == flags.get("beta", 1) == 1 and not flags.get("transA")
        chained = [name for name in node.input if name not in arrays] == [here]
        if op not in SIGNS or not (plain and chained and (op == "Add" or node.input[0] == here)):
            raise ValueError(
                f"operator {op}; expected {', '.join(SIGNS)} in a chain, alpha, beta 1"
            )
        here, order = node.output[0], order + SIGNS[op]
        if SIGNS[op] == "L":
            w = given[0] if flags.get("transB") else given[0].T
            layers.append((w, given[1] if len(given) > 1 else np.zeros(len(w))))
        elif op == "Add" and layers:
            layers[-1] = layers[-1][0], layers[-1][1] + given[0]
    if not re.fullmatch(r"L\+*(TL\+*)*|L\+*(RL\+*)*", order) or "ports" not in about:
        raise ValueError("expected layers, one activation between any two, metadata entry `ports`")
    return Policy(Ports(**json.loads(about["ports"])), layers, "relu" if "R" in order else "tanh")
