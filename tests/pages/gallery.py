"""One page with everything a page can hold, and names as nobody should write them."""

from __future__ import annotations

from functools import cache

import numpy as np

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt
from calibrary.pages.plots import (
    Axis,
    Band,
    Interval,
    Role,
    bars,
    correlations,
    distortion_map,
    intervals,
    poses,
    radial_curve,
)
from calibrary.pages.plots.svg_plots import amount_map, arrow_map, cell_centres
from calibrary.quality import Covariance
from calibrary.view import (
    Badge,
    Bullets,
    Code,
    Column,
    Details,
    Figure,
    KeyValues,
    Link,
    Note,
    Section,
    SideBySide,
    Table,
    Tone,
    View,
)

HOSTILE = (
    "<script>document.title='owned'</script>",
    "</style></title><img src=x onerror=alert(1)>",
    '" onmouseover="alert(1)" \'',
    "gpj.\u202eexe\u2066",
    "bell\x07 null\x00 escape\x1b[31m",
    "name\udcff of no encoding",
    "$\\frac{1}{0}$ {{ 7 * 7 }} {% raw %}",
    "e" + "\u0301" * 500,
    "x" * 10_000,
    "]]><!--",
)

SIZE = (5472, 3648)


def calibration(
    distortion: Distortion | None = None, size: tuple[int, int] = SIZE, focal: float = 3700.0
) -> Calibration:
    """A camera with its principal point a little off the middle."""
    width, height = size
    K = Intrinsics(fx=focal, fy=focal * 0.999, cx=width / 2 + 4.5, cy=height / 2 - 6.25, image_size=size)
    return Calibration(
        camera=CameraKey(make="Example", model="One", image_size=size),
        intrinsics=K,
        distortion=distortion,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="test"),
    )


BROWN = calibration(BrownConrady(k1=-0.07, k2=0.02, p1=0.0008, p2=-0.0003, k3=0.0))
FISHEYE = calibration(KannalaBrandt(k1=0.02, k2=-0.01, k3=0.0, k4=0.0), (1000, 1000), 300.0)


@cache
def plots() -> dict[str, Figure]:
    """Each kind of plot, of numbers that are the same in every run."""
    random = np.random.default_rng(5)
    residuals = random.normal(0, 0.2, (300, 2))
    y, x = np.mgrid[-1:1:12j, -1:1:18j]
    counts = np.where(np.hypot(x, y) < 1.2, np.round(9 - 6 * np.hypot(x, y)), np.nan)
    factor = random.normal(size=(5, 12))
    covariance = Covariance.from_matrix(("fx", "fy", "cx", "cy", "k1"), np.cov(factor))
    rms = np.abs(random.normal(0.25, 0.05, 12))
    rms[3] = 0.8
    labels = [*HOSTILE[:8], "IMG_0008.JPG", "IMG_0009.JPG", "IMG_0010.JPG", "IMG_0011.JPG"]
    shape = (12, 18)
    return {
        "bars": bars(rms, labels=labels, axis=Axis("rms", "px"), limit=0.5, caption="Views."),
        "arrow map": arrow_map(
            random.uniform((0, 0), SIZE, (300, 2)),
            residuals,
            SIZE,
            axis=Axis("residual", "px"),
            caption="Residuals.",
        ),
        "amount map": amount_map(
            cell_centres(shape, SIZE),
            0.1 + (x**2 + y**2) / 2,
            SIZE,
            axis=Axis("1 σ", "px"),
            caption="Uncertainty.",
        ),
        "coverage": amount_map(
            cell_centres(shape, SIZE), counts, SIZE, axis=Axis("corners"), caption="Coverage."
        ),
        "poses": poses(
            np.column_stack([residuals[:20], np.ones(20)]),
            random.uniform(700, 1500, 20),
            axis=Axis("distance", "mm"),
            caption="Board.",
        ),
        "correlations": correlations(covariance, caption="Correlations."),
        "intervals": intervals(
            [
                Interval(name="DewarpData", value=3700.0, half_width=0.5, role=Role.CHOSEN),
                Interval(name="focal length ÷ pitch", value=3690.0, role=Role.AGREES),
                Interval(name=HOSTILE[0], value=4900.0, half_width=150.0, role=Role.DISAGREES),
                Interval(name="fisheye", value=2100.0, role=Role.NO_K),
            ],
            axis=Axis("fx", "px"),
            band=Band(3590.0, 3810.0, "the catalogue"),
            caption="Estimates.",
        ),
        "displacement arrows": distortion_map(BROWN),
        "radial curve": radial_curve(BROWN),
        "radial curve of a fisheye": radial_curve(FISHEYE),
    }


def gallery() -> View:
    """The page."""
    columns = (Column("name"), Column("fx (px)", numeric=True), Column("verdict"), Column("words"))
    table = Table(
        caption=f"A wide table {HOSTILE[0]}",
        columns=columns,
        rows=tuple(
            (
                name,
                "3700.00",
                Badge(tone.value, tone),
                "words that make this a wide table, wider than a phone " * 2,
            )
            for name, tone in zip(HOSTILE, [*Tone, *Tone, *Tone], strict=False)
        ),
    )
    words = (
        "A paragraph.",
        Note(text="what is the matter", action="what to do", tone=Tone.BAD),
        Note(text="what to know", tone=Tone.CAUTION),
        Note(text="that is fine", tone=Tone.GOOD),
        Note(text=HOSTILE[1]),
        KeyValues((("fx", "3700.00 px"), ("name", HOSTILE[8]), ("verdict", Badge("valid", Tone.GOOD)))),
        table,
        Bullets((*HOSTILE, Link("to the plots", "#plots"))),
        Code(text="colmap feature_extractor --image_path IMAGES " * 6 + "\nsecond line", label="A command"),
        Details(summary="More", blocks=(Bullets(("one", "two")), table)),
        Badge("alone", Tone.NEUTRAL),
        Section(title="A part of it", blocks=("words", Section(title="A part of that", blocks=("words",)))),
    )
    return View(
        title=f"Everything {HOSTILE[0]} {HOSTILE[3]}",
        lead=f"All that a page can hold. {HOSTILE[2]}",
        badge=Badge("unproven", Tone.CAUTION),
        sections=(
            Section(title="Words", badge=Badge("valid", Tone.GOOD), blocks=words),
            Section(title="Plots", anchor="plots", blocks=(SideBySide(tuple(plots().values())),)),
            Section(title=HOSTILE[1], anchor='"><script>', blocks=("words",)),
        ),
        made_by="Made by a test.",
    )
