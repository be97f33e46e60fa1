# SPDX-License-Identifier: BSD-2-Clause
"""Reference implementation of the synchronised approach, derived from the mathematics.

Shares no code and as few formulas as possible with the models under test: attitude by quaternions
instead of modified Rodrigues parameters, time derivatives by second-order jets instead of printed
rate formulas, gravity terms as gradients of the potential, regressors as Jacobians of the linear
expressions they represent. Frames, names and units equal those on the ports; `C_XY` maps Y
components to X components.
"""
