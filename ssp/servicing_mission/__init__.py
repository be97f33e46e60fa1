# SPDX-License-Identifier: BSD-2-Clause
"""One mission: from 500 m to a stack at rest."""
