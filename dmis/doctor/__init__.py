"""The doctor: finds faults of multiple importance sampling in a table of shading samples of any renderer."""
