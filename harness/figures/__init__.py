"""Figures of results: one table per system, and what is derived from several variables."""
