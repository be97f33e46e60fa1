"""A system for others: one .ssp, one container FMU, a block diagram."""
