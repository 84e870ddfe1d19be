"""Solution of exercise 12: the samples of each technique vary around their own mean."""


def variance_curve(f, p_l, p_b, dx, w):
    """Return V at each share, ``(G,)``."""
    p_w = w[:, None] * p_l + (1 - w[:, None]) * p_b
    m_2, m_l, m_b = ((g / p_w).sum(axis=1) * dx for g in (f * f, p_l * f, p_b * f))
    return m_2 - w * m_l**2 - (1 - w) * m_b**2
