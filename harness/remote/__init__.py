# SPDX-License-Identifier: BSD-2-Clause
"""Components on other processors: what enters is an FMU and a place (an emulated processor, a
board), what leaves is an FMU of the same variables that stands for it (docs/protocol.md).

The firmware is built from the FMU's own sources; the FMU that stands for it speaks the protocol of
fmus/core/link and starts and ends the emulator by itself, so that any master can use it.
"""
