"""NumPy, imported at its first use, and the array types of the geometry code.

A registry is listed, and an entry found, without any geometry; importing NumPy takes longer than either.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

__all__ = ["ArrayLike", "BoolArray", "FloatArray", "IntArray", "NDArray", "np", "poly"]

if TYPE_CHECKING:
    import numpy as np
    from numpy.polynomial import polynomial as poly
    from numpy.typing import ArrayLike, NDArray

    FloatArray: TypeAlias = NDArray[np.float64]
    IntArray: TypeAlias = NDArray[np.intp]
    BoolArray: TypeAlias = NDArray[np.bool_]
else:

    class NDArray:
        """Stands for NumPy's type of an array of some kind of number, which only type checkers read."""

        def __class_getitem__(cls, kind: object) -> type:
            return cls

    ArrayLike = BoolArray = FloatArray = IntArray = NDArray

    class _OnUse:
        """Stands for a module until something of it is asked for, and keeps what was."""

        def __init__(self, module: str) -> None:
            self._module = module

        def __getattr__(self, name: str) -> object:
            from importlib import import_module  # noqa: PLC0415  needed only where the module is

            value = getattr(import_module(self._module), name)
            setattr(self, name, value)
            return value

    np, poly = _OnUse("numpy"), _OnUse("numpy.polynomial.polynomial")
