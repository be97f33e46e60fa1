# SPDX-License-Identifier: BSD-2-Clause
"""Reading and writing of SSP files. No other package reads or writes their XML.

Input: an .ssp of this project or of another tool, or the TOML file of a system. Output: a System
(module reader), or an .ssp in a form that every tool accepts (modules writer and build). No
function of an FMU is called.
"""
