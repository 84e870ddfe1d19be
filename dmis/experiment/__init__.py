"""Experiments: read `reference`, `metrics`, `runs`, `table`, `convergence`; `oracle` tells what weights could save."""
