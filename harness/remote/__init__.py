# SPDX-License-Identifier: BSD-2-Clause
"""Components that run on other processors. The input is an FMU and a place: an emulated processor
or a board. The output is a link FMU with the same variables, which represents the remote component
in a system (docs/protocol.md).

The firmware is built from the source code inside the FMU. The link FMU communicates with the
firmware by the protocol of fmus/core/link, and starts and ends the emulator itself, so that any
master can use it.
"""
