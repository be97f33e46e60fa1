# SPDX-License-Identifier: BSD-2-Clause
"""Files and folders that may come from anywhere or be lost at any time: archives, XML, the cache,
temporary folders, files that appear whole or not at all, and where the built parts are.
"""
