"""Report of a comparison: one HTML page with its images."""
