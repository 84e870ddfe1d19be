"""Lights: area lights, the environment, and lights of a single direction."""
