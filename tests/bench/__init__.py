# SPDX-License-Identifier: BSD-2-Clause
"""What a macro step costs, side by side with other masters, a bare loop and one C program."""
