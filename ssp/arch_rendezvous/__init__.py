# SPDX-License-Identifier: BSD-2-Clause
"""Mission of Chan & Mitra 2017: rendezvous in geostationary orbit with proved safety."""
