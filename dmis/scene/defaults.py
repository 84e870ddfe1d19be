"""Integrator and path depth of scenes that name none, and the largest depth."""

DEFAULT_INTEGRATOR = "direct"
"""Integrator of scenes made in Python. The reader of a file takes the default of the file's dialect."""
DEFAULT_DEPTH = 5
"""Default maximum path depth, in surfaces that a path visits; pbrt-v2's."""
MAX_DEPTH = 10_000
"""Largest maximum path depth."""
