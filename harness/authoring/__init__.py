# SPDX-License-Identifier: BSD-2-Clause
"""Creation of folders for components and missions of the user (their initial content already runs),
builds of FMUs from source files, and export of a system for other tools as one .ssp, one FMU, or C.
"""
