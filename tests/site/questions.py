# SPDX-License-Identifier: BSD-2-Clause
"""Questions in the words that people type into a search, and the page that answers each: a test
types them into the search of the site.
"""

QUESTIONS = {
    "add noise to sensors": "how_to/noise",
    "random seed": "how_to/noise",
    "run without noise": "how_to/noise",
    "write my own sensor": "how_to/own_sensor",
    "new plant": "how_to/own_sensor",
    "add a component to a system": "how_to/own_sensor",
    "initial attitude": "how_to/initial_state",
    "quaternion start": "how_to/initial_state",
    "different orbit": "how_to/another_orbit",
    "two-line elements": "how_to/another_orbit",
    "my own controller": "own_controller",
    "write a mission": "own_mission",
    "several machines": "campaigns",
    "read a report": "how_to/read_report",
    "what does not exercised mean": "verdicts",
    "exit status": "verdicts",
    "import simulink": "how_to/simulink_dymola",
    "fmpy": "other_tools",
    "monte carlo": "campaigns",
    "worst case": "studies",
    "probability of failure": "how_to/verdict",
    "repeat a failed run": "how_to/repeat_a_run",
    "thruster layout": "how_to/other_thrusters",
    "c code without fmi": "how_to/flight_code",
    "learn a control law": "how_to/learn",
}
"""Page without its ending by question."""
