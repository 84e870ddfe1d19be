"""Solution of exercise 1: keep the part along n, negate the part across n."""

from dmis.base.vectors import dot


def mirror(wo, n):
    """Return ``2 (n . wo) n - wo``, ``(3, N)``."""
    return 2 * dot(n, wo) * n - wo
