"""Checks of the exercises, one file for each tutorial; `dmis.testing.exercises` has them by number."""
