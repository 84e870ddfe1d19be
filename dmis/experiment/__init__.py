"""Experiments: references, errors, comparisons of rules, reports, speed."""
