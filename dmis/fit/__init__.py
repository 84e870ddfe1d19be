"""Weight rules: pilot statistics in, shares of samples out."""
