# SPDX-License-Identifier: BSD-2-Clause
"""Learn to hold 10 m on the grasp axis of a slowly turning target, and compare the learned policy,
as an FMU in C99, with the controller of the paper.

pip install stable-baselines3, then python examples/learn.py [STEPS]
"""

import sys

from harness import build, compare, environment
from harness.results.requirements import margin

SEED, STEPS = 1, 60_000
SET = {
    "guidance.rho_0": 10, "guidance.rho_M": 10, "target.omega_TN_T_0": [0, 0.002, 0],
    "servicer.sigma_SN_0": [-0.2, -0.0536, -0.7464],
}  # fmt: skip
ERROR = "norm(guidance.rho_H - guidance.rho_ref_H)"
HOLD = f"time < 60 s or {ERROR} <= 1 m"
STARTS = {
    "system": "sync_approach",
    "runs": 20_000,
    "seed": SEED,
    "fixed": {"params": "limited", "set": SET},
    "factors": {"servicer.rho_0_H": {"uniform": {"low": [-1.6, 9, -0.8], "high": [0.4, 11, 1.2]}}},
}


def make():
    """Return the environment: 2 s per action, an episode of 300 s, ended 5 m off."""
    return environment(
        "sync_approach",
        observe=["guidance.rho_H", "guidance.rho_ref_H", "guidance.drho_H"],
        act=["controller.F_cmd_S"],
        scale={"guidance.rho_H": 2.0, "guidance.rho_ref_H": 2.0, "guidance.drho_H": 0.05},
        reward=f"1 - 0.5 * {ERROR}", ends=(f"{ERROR} >= 5 m",), weights=0.0,
        every=20, stop=300, factors=STARTS,
    )  # fmt: skip


def train(steps):
    """Return the layers (W, b) of the network that PPO has learned."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    torch.set_num_threads(1)  # a network this small is slower on two
    model = PPO(
        "MlpPolicy", DummyVecEnv([make] * 8), n_steps=150, batch_size=300, gamma=0.97, seed=SEED,
        learning_rate=lambda left: 1e-3 * left, device="cpu",
        policy_kwargs={"net_arch": [32, 32], "log_std_init": -1.0},
    )  # fmt: skip
    model.learn(steps)
    actor = model.policy
    linear = [m for m in (*actor.mlp_extractor.policy_net, actor.action_net) if hasattr(m, "bias")]
    return [(m.weight.detach().double().numpy(), m.bias.detach().double().numpy()) for m in linear]


def episode(env, policy, run):
    """Return the result of an episode under a policy in Python, from a start of the campaign."""
    seen, _ = env.reset(seed=run)
    over = False
    while not over:
        seen, _, lost, out, _ = env.step(policy(seen))
        over = lost or out
    return env.result()


def beside_the_paper(policy, folder):
    """Return the comparison of the policy in C99 with the law of the paper."""
    policy.save("learned.npz")
    return compare(
        "sync_approach", folder,
        swap={"controller": ["adaptive_controller", build("learned.npz")]},
        params=["limited"], set=SET | {"servicer.rho_0_H": [0, 10.5, 0]}, stop=300,
        require={"hold": HOLD},
    )  # fmt: skip


if __name__ == "__main__":
    env = make()
    policy = env.policy(train(int(sys.argv[1]) if len(sys.argv) > 1 else STEPS))
    worst = min(margin(episode(env, policy, run), HOLD) for run in range(10))
    print(f"ten starts: hold {worst:+.2f} m from failing")
    found = beside_the_paper(policy, "learned")
    for name in (("position error", "m"), ("delta-v", "m/s"), ("saturated", "%")):
        shown = ", ".join(f"{label} {x:.3g}" for label, x in found.metrics[name].items())
        print(f"{' '.join(name)}: {shown}")
    for label, result in found.results.items():
        print(f"{label}: hold {margin(result, HOLD):+.2f} m from failing")
