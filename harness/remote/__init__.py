# SPDX-License-Identifier: BSD-2-Clause
"""Components on other processors. An FMU and a place (an emulated processor, a board) enter. An FMU
with the same variables that represents the remote component leaves (docs/protocol.md).

The firmware is built from the FMU's own sources. The representing FMU speaks the protocol of
fmus/core/link and starts and ends the emulator itself, so that any master can use it.
"""
