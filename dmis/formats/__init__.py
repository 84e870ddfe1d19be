"""Scene files: pbrt-v2, v3, v4, and mesh files with or without materials."""
