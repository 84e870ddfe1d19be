"""Meshes: from formulas, transforms, Loop subdivision."""
