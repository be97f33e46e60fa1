# SPDX-License-Identifier: BSD-2-Clause
"""What a mission lists as figures becomes pictures: of one run, of several in one, of a campaign.

A figure is drawn if the result holds what it needs; a result without any has a general one of every
component.
"""
