"""Checks of lobes, lights, techniques and rules, a user's own among them."""
