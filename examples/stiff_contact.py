# SPDX-License-Identifier: BSD-2-Clause
"""Where co-simulation matters: what a stiff spring between two FMUs gains or loses in a step.

Servicer and target in deep space, joined along one axis by 20 kN/m without damping, stepped apart
from each other. Prints the energy after a step divided by the energy before it, for several values
theta = omega h and several ways to hold or predict the force over a step; `stiff_contact.py FILE`
draws them too.
"""

import sys
import tomllib
from pathlib import Path

import numpy as np

from harness import build, run
from harness.files import paths
from harness.ssp.build import system_of

K, M_RED = 20000.0, 100 * 150 / 250
OMEGA = np.sqrt(K / M_RED)
THETAS = (0.05, 0.1, 0.2, 0.5, 1.0, 1.5, 1.9)
STEPS = 20

PAIR = """
name = "pair"
[experiment]
stop = 1.0
step = 0.01
[components]
COUPLING = "FMU"
servicer = "servicer"
target = "target"
[open]
"servicer.F_S" = [0, 0, 0]
"servicer.M_S" = [0, 0, 0]
"servicer.mdot" = 0
"servicer.wheel_accel_cmd" = [0, 0, 0]
MORE
[parameters.shared]
a = 0
mu = 0
use_J2 = 0
use_gravity_gradient = 0
[parameters.servicer]
r_0_N = [-1.58, 0, 0]
v_0_N = [1e-3, 0, 0]
[parameters.target]
mass = 150
omega_TN_T_0 = [0, 0, 0]
sigma_TN_0 = [0, 0, 0]
"""
SPRING = '"target.M_T" = [0, 0, 0]'
# latched and seated at once, without damping
LATCHED = """
"mechanism.latch_enable" = 1
"mechanism.release" = 0
[parameters.mechanism]
p_QT_T = [-0.6, 0, 0]
q_QT = [0, 0, 0, 1]
trip_force = 0
latch_dwell = 0
draw_delay = 1e-9
draw_time = 1e-9
c_hard = 0
c_rot_hard = 0
"""


def pair(coupling, fmu, more):
    text = PAIR.replace("COUPLING", coupling).replace("FMU", fmu).replace("MORE", more)
    return system_of(tomllib.loads(text), paths.fmus() | {"held_spring": Path("held_spring.fmu")})


def factor(system, theta, algorithm="gauss-seidel", **values):
    """Energy after a step over that before: the growth of x_n v_n+1 - x_n+1 v_n."""
    h = theta / OMEGA
    limits = {f"{body}.max_step": h for body in ("servicer", "target")}
    result = run(system, step=h, stop=STEPS * h, algorithm=algorithm, set=limits | values)
    x = result["servicer.r_SN_N"][:, 0] - result["target.r_TN_N"][:, 0] + 1.58
    v = result["servicer.v_SN_N"][:, 0] - result["target.v_TN_N"][:, 0]
    area = x[:-1] * v[1:] - x[1:] * v[:-1]
    return np.median(area[6:] / area[5:-1])


def table():
    """Names of the ways, and factors (thetas, ways)."""
    source = Path(__file__).parent / "held_spring.c"
    build(source, "held_spring.fmu")
    spring = pair("spring", "held_spring", SPRING)
    mechanism = pair("mechanism", "docking_mechanism", LATCHED)
    ways = {
        "held": lambda x: factor(spring, x),
        "held, a step late": lambda x: factor(spring, x, "jacobi"),
        "extrapolated": lambda x: factor(spring, x, **{"spring.extrapolate": 1}),
        "predicted mean": lambda x: factor(mechanism, x),
        "latency 1": lambda x: factor(mechanism, x, "jacobi", **{"mechanism.latency": 1}),
        "closed form": lambda x: np.cos(x) + x * np.sin(x) / 2,
    }
    return list(ways), np.array([[way(theta) for way in ways.values()] for theta in THETAS])


def draw(names, factors, file):
    import matplotlib.pyplot as plt

    plt.rcParams["svg.hashsalt"] = "stiff contact"
    figure, axes = plt.subplots(figsize=(7, 4))
    for name, column in zip(names, factors.T, strict=True):
        axes.plot(THETAS, column, "k--" if name == "closed form" else "o-", label=name)
    axes.set(xscale="log", ylim=(-0.2, 3), xlabel="theta = omega h", ylabel="energy per step")
    axes.legend()
    figure.savefig(file, metadata={"Date": None} if file.endswith(".svg") else None)


names, factors = table()
print("theta  " + "  ".join(f"{name:>17}" for name in names))
for theta, row in zip(THETAS, factors, strict=True):
    print(f"{theta:5.2f}  " + "  ".join(f"{value:17.6f}" for value in row))
if len(sys.argv) > 1:
    draw(names, factors, sys.argv[1])
