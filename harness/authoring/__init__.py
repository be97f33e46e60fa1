# SPDX-License-Identifier: BSD-2-Clause
"""Controllers and missions of the user: folders with a source that runs unchanged, and FMUs built
from such sources. Files of a system for other tools: one .ssp, one FMU, or C.
"""
