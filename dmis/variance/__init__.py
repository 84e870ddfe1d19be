"""Variance of the estimator: moments of samples, and V(w) at every share w from one pilot."""
