"""Solution of exercise 1: the part along n stays, the part across n turns round."""

from dmis.base.vectors import dot


def mirror(wo, n):
    """Return ``2 (n . wo) n - wo``, ``(3, N)``."""
    return 2 * dot(n, wo) * n - wo
