# SPDX-License-Identifier: BSD-2-Clause
"""Claims of Yin, Luo, Wei & Yuan 2017 on three controllers in two scenarios (docs/models.md C).

The paper prints neither initial states nor gains: a reproduced value shows that the claim can be
met, not that the authors used these numbers. Claims that compare controllers are checked in
tests/systems/test_ppc_claims.py and by `harness compare`.
"""

from __future__ import annotations

from harness.mission.claim import Band, Case, Claim, Paper, at_least, at_most
from harness.results.result import Result

from . import evaluations as metrics
from .evaluations import ATTITUDES, COMMAND, ELEVATION, FEATURE, FUNNEL, RANGE


def converges(seconds: float, where: str, least: float = 0.9) -> Claim:
    """Return the claim that the range converges in about `seconds`; where: section and figure of
    the paper; least: smallest ratio to this time that still counts as "about" (the largest is 1.1).
    """
    return Claim(
        name="convergence",
        text=f"the range converges in about {seconds:g} s",
        where=where,
        needs=(RANGE,),
        compute=metrics.convergence,
        value="within {1:.1f} m (2 %) after {0:.1f} s",
        unit="s",
        reproduced=Band(least * seconds, 1.1 * seconds),
        partly=Band(0.5 * least * seconds, 1.5 * seconds),
        interval=0.5,
    )


def steady(text: str, reproduced: Band, partly: Band) -> Claim:
    """Return the claim that the range error stays within a band while the target manoeuvres.
    text: words of the claim; reproduced, partly: bands of the largest range error after 40 s [m].
    """
    return Claim(
        name="accuracy under manoeuvre",
        text=text,
        where="section 4.3, figure 7",
        needs=(RANGE,),
        compute=metrics.steady_range_error,
        value="at most {0:.2f} m after 40 s, {1:.2f} m after 60 s",
        unit="m",
        reproduced=reproduced,
        partly=partly,
    )


HOVERS = Claim(
    name="hovering",
    text="the servicer approaches quickly and then hovers 20 m above the feature of the target",
    where="section 4.2, figure 2",
    needs=(RANGE, FEATURE),
    compute=metrics.hovering,
    value="range within {0:.3f} m after 60 s, at most {1:.2f} deg off the axis of the feature",
    unit="m",
    reproduced=at_most(0.1),
    partly=at_most(1.0),
)
ATTITUDE = Claim(
    name="attitude accuracy",
    text="the attitude is accurate in the steady state",
    where="section 4.2, figure 6",
    needs=ATTITUDES,
    compute=metrics.steady_attitude_error,
    value="at most {0:.4f} deg after 60 s, {1:.4f} deg in the last 20 s",
    unit="deg",
    reproduced=at_most(0.1),
    partly=at_most(1.0),
)
BARRIER = Claim(
    name="barrier",
    text="kappa < 1 and all generalised states inside their bounds for ever",
    where="theorem 1, (37), (39)",
    needs=FUNNEL,
    compute=metrics.barrier,
    value="kappa at most {0:.3f}, states at most at {1:.2f} of their bounds",
    unit="",
    reproduced=at_most(0.999),
    interval=0.5,
)
SMOOTH = Claim(
    name="smooth line of sight",
    text="the angles of the line of sight converge without oscillation",
    where="section 4.2, figure 4",
    needs=(ELEVATION, RANGE),
    compute=metrics.overshoot,
    value="overshoot of the elevation {0:.1f} deg; minimum range {1:.2f} m",
    unit="deg",
    reproduced=at_most(2.0),
    partly=at_most(5.0),
    interval=0.5,
)
OSCILLATION = Claim(
    name="oscillation",
    text="great oscillation during the convergence; the safety of the servicer is not guaranteed",
    where="figures 4, 7, section 5",
    needs=(ELEVATION, RANGE),
    compute=metrics.overshoot,
    value="overshoot of the elevation {0:.1f} deg; minimum range {1:.2f} m",
    unit="deg",
    reproduced=at_least(10.0),
    partly=at_least(5.0),
    interval=0.5,
)
SLOW = Claim(
    name="convergence",
    text="the convergence of the range is still slow",
    where="section 4.3, figure 7",
    needs=(RANGE,),
    compute=metrics.convergence,
    value="within {1:.1f} m (2 %) after {0:.1f} s",
    unit="s",
    reproduced=at_least(30.0),
    partly=at_least(20.0),
    interval=0.5,
)
UNAFFECTED = Claim(
    name="unaffected accuracy",
    text="the steady accuracy does not suffer from manoeuvre, uncertainty and disturbance",
    where="section 4.3, figure 7",
    needs=(RANGE,),
    compute=metrics.last_range_error,
    value="range error at most {0:.3f} m in the last 20 s",
    unit="m",
    reproduced=at_most(0.05),
    partly=at_most(0.5),
)
CHATTER = Claim(
    name="chattering command",
    text="severe oscillation of the control acceleration in the steady state, wasting fuel",
    where="section 4.3, figure 8",
    needs=(COMMAND,),
    compute=metrics.chatter,
    value="total variation after 60 s {0:.1f} times the span of the command (sinusoid: 2 a period)",
    unit="",
    reproduced=at_least(20.0),
    partly=at_least(10.0),
    interval=0.5,
)

TITLE = (
    "Yin Z., Luo J., Wei C., Yuan J.: Low-complexity prescribed performance control for "
    "approaching and tracking a "
    "non-cooperative target. Journal of Astronautics 38(8), 2017"
)
CONTROLLERS = {
    "prescribed performance": "controller.range.alpha_0",
    "theta-D": "controller.range.Q_error",
    "PID": "controller.range.Kp",
}
"""Parameter that only this controller has, by the name of the controller."""
FMUS = {
    "prescribed performance": "ppc_controller",
    "theta-D": "theta_d_controller",
    "PID": "pid_controller",
}
PERIODS = ("default", "period_10ms", "period_100ms")
"""Parameter sets that count as the case of section 4.2. They differ in the sample period of the
software, which the paper does not state.
"""
TABLES = {
    ("prescribed performance", False): (
        converges(18, "section 4.2, figure 3"),
        HOVERS,
        SMOOTH,
        ATTITUDE,
        BARRIER,
    ),
    ("theta-D", False): (converges(23, "section 4.2, figure 3"), HOVERS, SMOOTH, ATTITUDE),
    ("PID", False): (converges(40, "section 4.2, figure 3"), OSCILLATION, ATTITUDE),
    ("prescribed performance", True): (
        converges(25, "section 4.3, figure 7", least=0.0),
        steady("the range stays within +-0.5 m", at_most(0.5), at_most(1.0)),
        BARRIER,
    ),
    ("theta-D", True): (
        steady("the range stays only within +-3 m", Band(0.5, 3.0), at_most(6.0)),
        CHATTER,
    ),
    ("PID", True): (SLOW, OSCILLATION, UNAFFECTED),
}


def _cases(controller: str, manoeuvre: bool) -> tuple[Case, ...]:
    """Return the cases of the paper for a controller: of section 4.3 if the target manoeuvres, else
    of section 4.2. The cases of section 4.2 include the parameter set `literal_law`, with the gain
    law as printed, only for prescribed performance.
    """
    fmu = FMUS[controller]
    own = fmu == FMUS["prescribed performance"]
    sets = ("manoeuvre",) if manoeuvre else (*PERIODS, *(("literal_law",) if own else ()))
    swap = () if own else (("controller", fmu),)
    return tuple(Case("ppc_tracking", name, swap) for name in sets)


def _paper(controller: str, manoeuvre: bool, claims: tuple[Claim, ...]) -> Paper:
    def meant(result: Result) -> bool:
        return metrics.manoeuvring(result) is manoeuvre

    scenario = "4.3, unknown manoeuvre" if manoeuvre else "4.2, no manoeuvre"
    return Paper(
        title=f"{TITLE}: {controller}, section {scenario}",
        needs=("guidance.los.range",),
        parameters=(CONTROLLERS[controller], "target.a_manoeuvre_N.bias", "guidance.rho_f"),
        claims=claims,
        meant=meant,
        cases=_cases(controller, manoeuvre),
    )


PAPERS = tuple(_paper(*case, claims) for case, claims in TABLES.items())
