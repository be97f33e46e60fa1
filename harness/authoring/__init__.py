# SPDX-License-Identifier: BSD-2-Clause
"""Controllers of the user's own: a component of a system goes in, a folder with a source that flies
as it is comes out, and from the source an FMU.
"""
