# SPDX-License-Identifier: BSD-2-Clause
"""Mission: capture of a tumbling target by an arm (station-keeping, deployment, tracking, grip)."""
