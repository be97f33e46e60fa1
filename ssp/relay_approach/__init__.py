# SPDX-License-Identifier: BSD-2-Clause
"""Mission of Kozlova & Fomichev 2023: pursuit with relay control and a real propulsion unit."""
