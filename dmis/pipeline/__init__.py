"""Rendering: pilot, fit, final pass; tiles, executors, checkpoints, results."""
