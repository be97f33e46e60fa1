# SPDX-License-Identifier: BSD-2-Clause
"""Several runs of one system, or several looks at one FMU: comparisons, linear models, checks."""
