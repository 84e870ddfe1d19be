"""Command line: ``python -m dmis``."""
