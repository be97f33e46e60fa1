# SPDX-License-Identifier: BSD-2-Clause
"""Creation of components and missions of the user (folders whose content runs unchanged), builds of
FMUs from source files, and export of a system for other tools as one .ssp, one FMU, or C.
"""
