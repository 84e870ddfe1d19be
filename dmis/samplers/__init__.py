"""Samplers: streams of uniform numbers, maps from them to directions and shapes, pixel filters."""
