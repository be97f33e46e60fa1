# SPDX-License-Identifier: BSD-2-Clause
"""Mission of Guo et al. 2014: free-floating two-link robot under gravity gradient."""
