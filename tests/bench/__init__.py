# SPDX-License-Identifier: BSD-2-Clause
"""Cost of a macro step, side by side with other masters, a bare loop and one C program."""
