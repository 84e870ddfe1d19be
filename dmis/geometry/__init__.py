"""Meshes: from files and formulas, transforms, Loop subdivision."""
