"""Drawing of plots: the common style, and output that is byte-identical for the same numbers on every machine."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from calibrary.arrays import FloatArray
from calibrary.errors import InputError
from calibrary.pages.palette import Colour
from calibrary.pages.wording import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas


UNITS_PER_INCH = 72
MOST_POINTS = 2_000
"""Most marks in one plot; from more, a subset is drawn to limit the size of the page."""

LONGEST_NAME = 48

INK, MUTED = Colour.INK.light, Colour.MUTED.light

LOOK: dict[str, dict[str, str | float | bool]] = {
    "svg": {"fonttype": "none", "hashsalt": "calibrary"},
    # matplotlib would take a name with two $ for a formula.
    "text": {"parse_math": False, "color": INK},
    "font": {"family": "DejaVu Sans", "size": 12},
    "axes": {
        "labelsize": 12,
        "labelcolor": INK,
        "edgecolor": MUTED,
        "facecolor": "none",
        "axisbelow": True,
        "spines.top": False,
        "spines.right": False,
        "formatter.useoffset": False,
    },
    "xtick": {"color": MUTED, "labelcolor": INK, "labelsize": 11},
    "ytick": {"color": MUTED, "labelcolor": INK, "labelsize": 11},
    "grid": {"color": Colour.LINE.light, "linewidth": 0.8},
    "figure": {"facecolor": "none", "constrained_layout.use": True},
    "savefig": {"facecolor": "none"},
    "image": {"composite_image": False},
}


class Axis(Struct, frozen=True):
    """Quantity and unit of an axis: Axis("tilt", "°"); no unit for a dimensionless number."""

    quantity: str
    unit: str = ""

    @property
    def label(self) -> str:
        """Text of the axis label."""
        quantity = visible(self.quantity, LONGEST_NAME)
        return f"{quantity} ({visible(self.unit, LONGEST_NAME)})" if self.unit else quantity

    def of(self, value: float) -> str:
        """A value with its unit, to three digits."""
        return f"{number(value)} {self.unit}".strip() if self.unit != "°" else f"{number(value)}°"


def draw(paint: Callable[[Canvas], None], *, width: int, height: int, smooth: bool = False) -> str:
    """Draw a plot and return it as SVG.

    Args:
        paint: draws on an empty figure.
        width: in SVG units; 520 fits two to a row on a wide screen, 760 fills the text's width.
        height: in SVG units.
        smooth: whether the browser may interpolate between the cells of an image.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure as Canvas

    # Newer releases of matplotlib list every group's name in the type.
    configure: Callable[..., None] = mpl.rc
    text = io.StringIO()
    with mpl.rc_context(), warnings.catch_warnings():
        # If the font used for measuring lacks a glyph, the reader's own font draws it.
        warnings.simplefilter("ignore", UserWarning)
        mpl.rcdefaults()
        for group, settings in LOOK.items():
            configure(group, **settings)
        canvas = Canvas(figsize=(width / UNITS_PER_INCH, height / UNITS_PER_INCH), dpi=UNITS_PER_INCH)
        paint(canvas)
        canvas.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    svg = text.getvalue()
    return svg.replace("image-rendering:crisp-edges;image-rendering:pixelated", "") if smooth else svg


def as_values(values: ArrayLike, what: str) -> FloatArray:
    """Convert to (N,) float64; NaN is a gap.

    Raises:
        InputError: the array has another shape.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1:
        raise InputError(f"{what} has shape {array.shape}, expected (N,)")
    return np.where(np.isfinite(array), array, math.nan)


def as_points(values: ArrayLike, what: str, columns: int = 2) -> FloatArray:
    """Convert to (N, columns) float64.

    Raises:
        InputError: the array has another shape.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != columns:
        raise InputError(f"{what} has shape {array.shape}, expected (N, {columns})")
    return array


def thinned(count: int, most: int = MOST_POINTS) -> NDArray[np.intp]:
    """Indices of the marks to draw: all, or a random subset of ``most`` with a fixed seed."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, most, replace=False))


def number(value: float) -> str:
    """Format to three digits, without an exponent for numbers of ordinary size."""
    if not math.isfinite(value):
        return "unknown"
    if value == 0 or 1e-4 <= abs(value) < 1e6:
        decimals = max(0, 2 - math.floor(math.log10(abs(value)))) if value else 0
        text = f"{value:.{decimals}f}"
        return (text.rstrip("0").rstrip(".") if "." in text else text).replace("-", "−")
    return f"{value:.3g}".replace("-", "−")


def name(text: str) -> str:
    """Shorten a label so that it fits in a plot."""
    shown = visible(text)
    return shown if len(shown) <= LONGEST_NAME else shown[: LONGEST_NAME - 1] + "…"


def frame_axes(axes: Axes, image_size: tuple[int, int]) -> None:
    """Set the axes to image coordinates: x right, y down, in px from the outer corner of the top-left pixel."""
    width, height = image_size
    axes.set_aspect("equal")
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    axes.spines[["top", "right"]].set_visible(True)
    axes.set_xlabel("x (px)")
    axes.set_ylabel("y (px)")
