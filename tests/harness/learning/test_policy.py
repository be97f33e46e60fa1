# SPDX-License-Identifier: BSD-2-Clause
"""Learned policies as FMUs: the same numbers as in Python, in closed loop and in comparisons."""

import numpy as np
import pytest

from harness import build, compare, environment, run
from harness.authoring import policy as policies
from harness.errors import UsageError
from harness.learning.spaces import _ports
from tests.close import close


def network(rng, *widths):
    pairs = zip(widths, widths[1:], strict=False)
    return [(rng.normal(size=(b, a)) / a, 0.1 * rng.normal(size=b)) for a, b in pairs]


@pytest.fixture(scope="module", params=["tanh", pytest.param("relu", marks=pytest.mark.long)])
def learned(request, tmp_path_factory):
    """Environment, policy and FMU of the policy."""
    env = environment(
        "ppc_tracking", observe=["servicer.r_SN_N", "target.r_TN_N", "servicer.omega_SN_S"],
        scale={"servicer.r_SN_N": 1e7, "target.r_TN_N": 1e7, "servicer.omega_SN_S": 0.01},
        act=["controller.F_cmd_S", "controller.M_cmd_S"], stop=4.0, every=2, ends=(),
    )  # fmt: skip
    made = env.policy(network(np.random.default_rng(5), 9, 16, 8, 6), request.param)
    file = tmp_path_factory.mktemp("policy") / "learned.npz"
    made.save(file)
    yield env, made, build(file)
    env.close()


def test_the_fmu_gives_what_the_policy_gives_in_closed_loop(learned):
    env, policy, fmu = learned
    observation, _ = env.reset()
    over = False
    while not over:
        observation, _, _, over, _ = env.step(policy(observation))
    expected = env.result()
    found = run("ppc_tracking", swap={"controller": fmu}, stop=4.0, every=2)
    for name in ("controller.F_cmd_S", "controller.M_cmd_S", "servicer.omega_SN_S"):
        close(found[name], expected[name], rel=1e-12)
    distance = (r["servicer.r_SN_N"] - r["target.r_TN_N"] for r in (found, expected))
    close(*distance, rel=1e-9)  # 20 m as a difference of 7000 km
    assert np.ptp(found["controller.F_cmd_S"]) > 1


@pytest.mark.long
def test_the_policy_is_compared_with_its_verdicts(learned, tmp_path):
    _, _, fmu = learned
    found = compare(
        "ppc_tracking", tmp_path, swap={"controller": ["ppc_controller", fmu]}, stop=4.0
    )
    assert len(found.results) == 2
    assert not found.failures


def test_saved_policies_are_the_same(learned, tmp_path):
    _, policy, _ = learned
    policy.save(tmp_path / "p.npz")
    again = policies.read(tmp_path / "p.npz")
    x = np.linspace(-2, 2, 9)
    np.testing.assert_array_equal(again(x), policy(x))


def test_networks_that_do_not_fit_are_errors(learned, tmp_path):
    env, _, _ = learned
    with pytest.raises(UsageError, match=r"layer 1: expected weights \(4, 9\)"):
        env.policy([(np.zeros((4, 3)), np.zeros(4))])
    with pytest.raises(UsageError, match="has 4 outputs for 6 commanded values"):
        env.policy([(np.zeros((4, 9)), np.zeros(4))])
    for content in (b"nothing", b"", b"PK\x03\x04garbage"):
        (tmp_path / "bad.npz").write_bytes(content)
        with pytest.raises(UsageError, match="is not a policy"):
            build(tmp_path / "bad.npz")


def test_variables_of_two_components_with_one_name_are_no_policy():
    assert _ports(["a.x[1] [m]", "a.x[2] [m]"]) == [("x", "m", 2)]
    for names in (["a.x[1] [m]", "a.x[2] [m]", "b.x [rad]"], ["a.1x [m]"]):
        with pytest.raises(UsageError, match="must be a unique, valid name in C"):
            _ports(names)


@pytest.mark.interop
@pytest.mark.tool("onnx", "onnx")
def test_a_network_of_onnx_is_the_same_policy(learned, tmp_path):
    import json
    from dataclasses import asdict

    onnx = pytest.importorskip("onnx", reason="onnx is not installed")
    from onnx import TensorProto, helper, numpy_helper

    _, policy, _ = learned
    nodes, arrays, last = [], [], "x"
    word = {"tanh": "Tanh", "relu": "Relu"}[policy.activation]
    for i, (w, b) in enumerate(policy.layers):
        arrays += [numpy_helper.from_array(w, f"W{i}"), numpy_helper.from_array(b, f"b{i}")]
        nodes.append(helper.make_node("Gemm", [last, f"W{i}", f"b{i}"], [f"y{i}"], transB=1))
        nodes.append(helper.make_node(word, [f"y{i}"], [f"f{i}"]))
        last = f"f{i}"
    values = [helper.make_tensor_value_info(n, TensorProto.DOUBLE, [1, k])
              for n, k in (("x", 9), (f"y{len(policy.layers) - 1}", 6))]  # fmt: skip
    graph = helper.make_graph(nodes[:-1], "policy", values[:1], values[1:], arrays)
    model = helper.make_model(graph)
    helper.set_model_props(model, {"ports": json.dumps(asdict(policy.ports))})
    onnx.save(model, tmp_path / "p.onnx")
    x = np.linspace(-2, 2, 9)
    np.testing.assert_array_equal(policies.read(tmp_path / "p.onnx")(x), policy(x))
    first, between, second = nodes[:3]
    after = helper.make_node(word, ["y1"], ["f"])
    linear = helper.make_node("Gemm", ["y0", "W1", "b1"], ["y1"], transB=1)
    scaled = helper.make_node("Gemm", ["x", "W0", "b0"], ["y0"], transB=1, alpha=0.5)
    shifted = helper.make_node("Add", ["f0", "b0"], ["s"])
    late = helper.make_node("Gemm", ["s", "W1", "b1"], ["y1"], transB=1)
    skip = helper.make_node(word, ["x"], ["f0"])
    for others in (
        [first, between, second, after],
        [first, linear],
        [scaled, between, second],
        [first, between, shifted, late],
        [first, skip, second],
    ):
        del graph.node[:]
        graph.node.extend(others)
        odd = helper.make_model(graph)
        helper.set_model_props(odd, {"ports": json.dumps(asdict(policy.ports))})
        onnx.save(odd, tmp_path / "odd.onnx")
        with pytest.raises(UsageError, match="is not a policy"):
            policies.read(tmp_path / "odd.onnx")
