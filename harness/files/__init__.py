# SPDX-License-Identifier: BSD-2-Clause
"""Safe handling of files: untrusted archives and XML, the cache, temporary folders, output files
that appear completely or not at all, and the locations of the built FMUs and libraries.
"""
