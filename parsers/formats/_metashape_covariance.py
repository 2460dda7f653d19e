"""The covariance that Metashape writes with a calibration: names of the parameters, and the matrix row by row.

Example::

    <covariance> <params>f cx cy b1 b2 k1 k2 k3 p1 p2</params> <coeffs>…</coeffs> </covariance>

in px for f, cx, cy, b1 and b2. fx = f + b1, so the variance of fx includes the covariance of the two.
Parameters that are not named were fixed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion import BrownConrady, Distortion
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.quality import Covariance, Quality

if TYPE_CHECKING:
    from lxml.etree import _Element

__all__ = ["COVARIANCE", "read_covariance", "written_covariance"]

COVARIANCE: Final = "covariance"
MOST: Final = 32
SLIGHTLY_NEGATIVE: Final = -1e-9


def read_covariance(element: _Element | None, distortion: Distortion | None) -> Quality | None:
    """Read the standard deviations and, if the matrix is valid, the covariance, by parameter name of K and the model.

    Negative variances (from a nearly singular adjustment) are omitted, and then no correlations are read.

    Raises:
        ParseError: it is not a square matrix of distinct parameters.
    """
    if element is None:
        return None
    names = tuple((element.findtext("params") or "").split())
    size = len(names)
    if len(set(names)) != size or size > MOST:
        raise ParseError(f"its covariance is of {size} parameters, expected each once", place=COVARIANCE)
    coefficients = strict.numbers(element.findtext("coeffs") or "", count=size**2, place=COVARIANCE)
    native = np.array(coefficients).reshape(size, size)
    sums = {name: parts for name, parts in _sums(distortion).items() if parts[0] in names}
    if not sums:
        return None
    to_ours = np.array([[float(name in parts) for name in names] for parts in sums.values()])
    matrix = to_ours @ native @ to_ours.T
    variances = dict(zip(sums, np.diag(matrix).tolist(), strict=True))
    std = {name: value**0.5 for name, value in variances.items() if value >= 0}
    if not std:
        return None
    return Quality(std=std, covariance=_covariance(tuple(sums), matrix))


def written_covariance(quality: Quality, distortion: Distortion | None) -> str:
    """The element for a calibration's covariance; empty if Metashape's parameters cannot represent it.

    It includes the variance factor, which the format cannot state separately.
    """
    ours = quality.covariance
    if ours is None or not {"fx", "fy"} <= set(ours.names):
        return ""
    # b1 = fx − fy; the other parameters correspond one to one.
    rows: dict[str, Mapping[str, float]] = {"f": {"fy": 1.0}, "b1": {"fx": 1.0, "fy": -1.0}}
    for name, (native, *more) in _sums(distortion).items():
        if name in ours.names and name != "fy" and not more:
            rows[native] = {name: 1.0}
    left_over = set(ours.names) - {name for row in rows.values() for name in row}
    if left_over:
        return ""
    to_native = np.array([[row.get(name, 0.0) for name in ours.names] for row in rows.values()])
    matrix = to_native @ (ours.matrix * quality.inflation) @ to_native.T
    coefficients = " ".join(map(repr, matrix.ravel().tolist()))
    return f"<covariance><params>{' '.join(rows)}</params><coeffs>{coefficients}</coeffs></covariance>"


def _sums(distortion: Distortion | None) -> dict[str, tuple[str, ...]]:
    """Metashape's parameters that add up to each parameter of calibrary."""
    swapped = {"p1": "p2", "p2": "p1"} if isinstance(distortion, BrownConrady) else {}
    lens = {name: (swapped.get(name, name),) for name in (distortion.names() if distortion else ())}
    return {"fx": ("f", "b1"), "fy": ("f",), "cx": ("cx",), "cy": ("cy",), "skew": ("b2",), **lens}


def _covariance(names: tuple[str, ...], matrix: FloatArray) -> Covariance | None:
    spread = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if (np.diag(matrix) < 0).any() or not np.allclose(matrix, matrix.T, atol=0.0, rtol=1e-6):
        return None
    unit = matrix / np.outer(*(np.where(spread > 0, spread, 1.0),) * 2)
    if np.linalg.eigvalsh((unit + unit.T) / 2)[0] < SLIGHTLY_NEGATIVE:
        return None
    return Covariance.from_matrix(names, (matrix + matrix.T) / 2)
