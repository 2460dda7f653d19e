"""Tail probabilities for significance tests: upper tails of χ² and F, both tails of the normal distribution.

How a standard deviation is written stands here too. SciPy has the same tails, but would add 110 MB to every
installation.

Sources: NIST Digital Library of Mathematical Functions, 8.11.4 and 8.9.2 (incomplete gamma function: series and
continued fraction), 8.17.22 (incomplete beta function), 5.11.1 (Stirling's series); W. J. Lentz, "Generating Bessel
functions in Mie scattering calculations using continued fractions", Applied Optics 15 (1976), for their evaluation.
"""

from __future__ import annotations

import math
from collections.abc import Callable

MOST_TERMS = 100_000
STIRLING_FROM = 20.0
TINY = 1e-300
EPSILON = 2.0**-53


def chi_square_tail(dof: float, value: float) -> float:
    """Return the probability that χ² with ``dof`` degrees of freedom (any number > 0) exceeds ``value``.

    The result is NaN if an argument is NaN or ``dof`` is not positive.
    """
    if math.isnan(dof) or math.isnan(value) or dof <= 0:
        return math.nan
    if value <= 0:
        return 1.0
    a, x = dof / 2, value / 2
    if math.isinf(x):
        return 0.0
    scale = math.exp(_log_gamma_density(a, x))
    if x < a + 1:
        return max(0.0, 1.0 - scale * _gamma_series(a, x) / a)
    return scale * _lentz(x + 1 - a, lambda n: (-n * (n - a), x + 2 * n + 1 - a))


def f_tail(dof: float, dof_below: float, value: float) -> float:
    """Return the probability that F with (``dof``, ``dof_below``) degrees of freedom exceeds ``value``."""
    if any(map(math.isnan, (dof, dof_below, value))) or dof <= 0 or dof_below <= 0:
        return math.nan
    if value <= 0:
        return 1.0
    if math.isinf(value):
        return 0.0
    whole = dof_below + dof * value
    return _incomplete_beta(dof_below / 2, dof / 2, dof_below / whole, dof * value / whole)


def normal_tails(z: float) -> float:
    """Return the probability that a standard normal variable is farther from 0 than ``z``, on either side."""
    return math.erfc(abs(z) / math.sqrt(2))


def _log_gamma_density(a: float, x: float) -> float:
    """Return log(xᵃ e⁻ˣ / Γ(a)); for large ``a`` without subtracting large numbers."""
    if a < STIRLING_FROM:
        return a * math.log(x) - x - math.lgamma(a)
    off = (x - a) / a
    correction = (1 / 12 - (1 / 360 - (1 / 1260 - 1 / (1680 * a**2)) / a**2) / a**2) / a
    return 0.5 * math.log(a / (2 * math.pi)) + a * (math.log1p(off) - off) - correction


def _gamma_series(a: float, x: float) -> float:
    """Return Σ xⁿ / ((a+1) … (a+n))."""
    total = term = 1.0
    for n in range(1, MOST_TERMS):
        term *= x / (a + n)
        total += term
        if term < total * EPSILON:
            break
    return total


def _incomplete_beta(a: float, b: float, x: float, y: float) -> float:
    """Return the regularised incomplete beta function I(x; a, b), where y = 1 − x."""
    if x > (a + 1) / (a + b + 2):
        return max(0.0, 1.0 - _incomplete_beta(b, a, y, x))
    log_scale = a * math.log(x) + b * math.log(y) - _log_beta(a, b) if x > 0 else -math.inf

    def fraction(n: int) -> tuple[float, float]:
        m = n // 2
        if n % 2:
            return -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)), 1.0
        return m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)), 1.0

    return math.exp(log_scale) / a * _lentz(1.0, fraction)


def _log_beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)


def _lentz(first: float, fraction: Callable[[int], tuple[float, float]]) -> float:
    """Return 1 / (first + p₁/(q₁ + p₂/(q₂ + …))), where ``fraction(n)`` is (pₙ, qₙ)."""
    value = above = first if first != 0 else TINY
    below = 0.0
    for n in range(1, MOST_TERMS):
        p, q = fraction(n)
        below = 1 / ((q + p * below) or TINY)
        above = (q + p / above) or TINY
        value *= above * below
        if abs(above * below - 1) < 4 * EPSILON:
            break
    return 1 / value


def whole_percent(share: float) -> str:
    """Return a share in whole per cent, never rounded up to the limit that it misses."""
    return f"{math.floor(share * 100 + 1e-9)}%"


def two_digits(value: float) -> str:
    """Return the value to two digits, and above 100 to the whole number; never as a power of ten.

    >>> two_digits(0.0467), two_digits(4.0), two_digits(372.3)
    ('0.047', '4', '372')
    """
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"
