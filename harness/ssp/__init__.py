# SPDX-License-Identifier: BSD-2-Clause
"""SSP files: the only package that reads or writes their XML.

What enters: an .ssp of ours or of another tool, or a TOML of the project. What leaves: a System
(reader), or an .ssp in the dialect that every tool accepts (writer, build). No FMI call is made.
"""
