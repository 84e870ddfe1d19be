"""The text formats of pbrt-v2, v3 and v4, one file per concern."""
