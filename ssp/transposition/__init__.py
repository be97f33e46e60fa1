# SPDX-License-Identifier: BSD-2-Clause
"""Mission of Zhang et al. 2016: transposition of a docked assembly with limited momentum."""
