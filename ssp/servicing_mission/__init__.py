# SPDX-License-Identifier: BSD-2-Clause
"""Chan & Mitra 2017: rendezvous in geostationary orbit with proved safety."""
