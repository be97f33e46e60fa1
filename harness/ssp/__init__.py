# SPDX-License-Identifier: BSD-2-Clause
"""Reading and writing of SSP files. No other package reads or writes their XML.

Input: an .ssp of this project or of another tool, or the TOML file of a system. Output: a System
(reader), or an .ssp in the dialect that every tool accepts (writer, build). No FMI call is made.
"""
