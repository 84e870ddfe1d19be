"""Marks in the keys by which `dmis.samplers.streams.Sampler.draw` tells dimensions apart."""

MORE = -1
"""Mark of the second pair of numbers of a shading sample."""
CONTINUE = -2
"""Mark of the direction in which a path goes on; the key of a path's vertex has as many as the path has bounces."""
ROUNDING = -3
"""Mark of the numbers, and of the order, by which counts of shading samples are rounded up or down."""
LENS = -4
"""Mark of the point on the lens of a camera."""
