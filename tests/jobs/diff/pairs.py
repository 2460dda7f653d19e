"""Pairs of calibrations whose relation is known, each with what a comparison has to say of them.

The camera is a Phantom 4 RTK's: 5472×3648 px, k1 = −0.269. A pair that differs by more than 0.5 px rms, 1 px at most or
0.05 % in scale matters; ``alarm`` is the exit code 1, and an input error 3.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from calibrary.calibration import Calibration, CameraKey, Grade, Quality
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion
from calibrary.jobs.diff.comparison import ChangeVerdict
from calibrary.jobs.diff.verdicts import Kind
from calibrary.records import replace
from tests.jobs.diff.cameras import LENS, camera, changed
from tests.jobs.diff.made import (
    NAMES,
    STD,
    H,
    W,
    as_rational,
    divided,
    drawn,
    focal,
    graded,
    lens,
    measured,
    mirrored,
    of_model,
    on,
    other_lens,
    quarter,
    rational,
    same_projection_as_rational,
    scattered,
    silent,
    turned_180,
)

IDENTICAL, NOISE, NEGLIGIBLE, UNRESOLVED, DRIFT, STRUCTURAL = ChangeVerdict


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two calibrations and what is expected of their comparison.

    Attributes:
        name: of the case.
        a, b: the two.
        verdict: None for an input error.
        alarm: whether it needs attention.
        kind: the change of kind that has to be named.
        says: a part of what is shown.
    """

    name: str
    a: Calibration
    b: Calibration
    verdict: ChangeVerdict | None
    alarm: bool
    kind: Kind | None = None
    says: str = ""


def kind_of(
    *, name: str, a: Calibration, b: Calibration, kind: Kind, says: str = "", alarm: bool = True
) -> Pair:
    """A change of kind."""
    return Pair(name=name, a=a, b=b, verdict=STRUCTURAL, alarm=alarm, kind=kind, says=says)


def pairs() -> Iterator[Pair]:
    """Every case."""
    yield from equal()
    yield from edited()
    yield from conventions()
    yield from frames()
    yield from units()
    yield from repeated()
    yield from one_sided()


def equal() -> Iterator[Pair]:
    a = camera()
    yield Pair(name="identical", a=a, b=a, verdict=IDENTICAL, alarm=False, says="Use either")
    yield Pair(name="identical, measured", a=measured(a), b=measured(a), verdict=IDENTICAL, alarm=False)
    renamed = replace(
        a, camera=CameraKey(), provenance=replace(a.provenance, source="copy.xml", date="2026-05-01")
    )
    yield Pair(name="identical, another name and date", a=a, b=renamed, verdict=IDENTICAL, alarm=False)
    digits = changed(a, fx=float(f"{a.intrinsics.fx + 1e-9:.9g}"))
    yield Pair(name="only formatting differs", a=a, b=digits, verdict=IDENTICAL, alarm=False)
    six = lens(**{name: float(f"{value * (1 + 4e-7):.15g}") for name, value in LENS.coefficients.items()})
    yield Pair(
        name="rounded to six digits", a=a, b=six, verdict=NEGLIGIBLE, alarm=False, says="no map will show"
    )
    yield Pair(
        name="same lens as rational", a=a, b=camera(distortion=rational()), verdict=IDENTICAL, alarm=False
    )
    yield Pair(
        name="other model, same projections",
        a=a,
        b=same_projection_as_rational(),
        verdict=NEGLIGIBLE,
        alarm=False,
    )
    yield Pair(
        name="f +0.004 %", a=a, b=focal(4e-5), verdict=NEGLIGIBLE, alarm=False, says="below the limits"
    )
    yield Pair(
        name="cx +0.8 px", a=a, b=changed(a, cx=a.intrinsics.cx + 0.8), verdict=NEGLIGIBLE, alarm=False
    )
    yield Pair(name="k1 +1e-5", a=a, b=lens(k1=LENS.k1 + 1e-5), verdict=NEGLIGIBLE, alarm=False)
    significant = measured(focal(4e-5), 0.02), measured(a, 0.02)
    yield Pair(
        name="significant, but small", a=significant[1], b=significant[0], verdict=NEGLIGIBLE, alarm=False
    )


def edited() -> Iterator[Pair]:
    a = camera()
    K = a.intrinsics
    yield kind_of(
        name="k3 dropped",
        a=a,
        b=lens(k3=0.0),
        says="k3 is missing in B",
        kind=Kind.COEFFICIENT_LOST,
    )
    yield kind_of(
        name="k3 dropped in A",
        a=lens(k3=0.0),
        b=a,
        says="k3 is missing in A",
        kind=Kind.COEFFICIENT_LOST,
    )
    yield kind_of(
        name="k2, k3 dropped",
        a=a,
        b=lens(k2=0.0, k3=0.0),
        says="k2 and k3 are missing",
        kind=Kind.COEFFICIENT_LOST,
    )
    yield kind_of(
        name="p1, p2 dropped",
        a=a,
        b=lens(p1=0.0, p2=0.0),
        says="p1 and p2 are missing in B",
        kind=Kind.COEFFICIENT_LOST,
    )
    yield kind_of(
        name="k3 dropped, both measured",
        a=measured(a),
        b=measured(lens(k3=0.0)),
        says="Use A",
        kind=Kind.COEFFICIENT_LOST,
    )
    tiny = replace(LENS, k3=1e-9)
    yield Pair(
        name="a k3 that does nothing dropped",
        a=camera(distortion=tiny),
        b=camera(distortion=replace(tiny, k3=0.0)),
        verdict=STRUCTURAL,
        alarm=False,
        kind=Kind.COEFFICIENT_LOST,
    )
    yield Pair(
        name="all distortion lost",
        a=a,
        b=camera(distortion=NoDistortion()),
        verdict=STRUCTURAL,
        alarm=True,
        kind=Kind.DISTORTION_LOST,
        says="Use A",
    )
    yield Pair(
        name="cx +20 px", a=a, b=changed(a, cx=K.cx + 20), verdict=DRIFT, alarm=True, says="only cx differs"
    )
    yield Pair(
        name="k1 +0.005", a=a, b=lens(k1=LENS.k1 + 0.005), verdict=DRIFT, alarm=True, says="only k1 differs"
    )
    traded = focal(0.002, lens(k1=LENS.k1 - 0.004))
    yield Pair(
        name="f +0.2 %, k1 −0.004", a=a, b=traded, verdict=DRIFT, alarm=True, says="only fx, fy and k1 differ"
    )
    yield Pair(name="f +0.1 %", a=a, b=focal(0.001), verdict=DRIFT, alarm=True, says="held fixed")
    yield Pair(
        name="k1 +0.005 on another date",
        a=on(a, "2026-01-01"),
        b=on(lens(k1=LENS.k1 + 0.005), "2026-06-01"),
        verdict=DRIFT,
        alarm=True,
        says="only k1 differs",
    )
    yield Pair(
        name="cx +20 px, both measured loosely",
        a=measured(a, 50),
        b=measured(changed(a, cx=K.cx + 20), 50),
        verdict=DRIFT,
        alarm=True,
        says="only cx differs",
    )
    yield kind_of(
        name="skew on one side",
        a=a,
        b=changed(a, skew=5.0),
        kind=Kind.COEFFICIENT_LOST,
        says="the skew (b2 = 5) is missing in A",
    )
    fisheye = camera(distortion=KannalaBrandt(k1=-0.2, k2=0.05, k3=0.0, k4=0.0))
    yield Pair(
        name="another model in its place", a=a, b=fisheye, verdict=DRIFT, alarm=True, says="distortion model"
    )
    yield Pair(
        name="fy alone +0.1 %", a=a, b=changed(a, fy=K.fy * 1.001), verdict=DRIFT, alarm=True, says="only fy"
    )


def conventions() -> Iterator[Pair]:
    a = camera()
    K = a.intrinsics
    for by in (0.5, -0.5):
        yield Pair(
            name=f"half a pixel {by:+g}",
            a=a,
            b=changed(a, cx=K.cx + by, cy=K.cy + by),
            verdict=STRUCTURAL,
            alarm=True,
            kind=Kind.HALF_PIXEL,
            says="centre of the first pixel",
        )
    yield Pair(
        name="a whole pixel",
        a=a,
        b=changed(a, cx=K.cx + 1, cy=K.cy + 1),
        verdict=STRUCTURAL,
        alarm=True,
        kind=Kind.ORIGIN,
        says="from 1",
    )
    yield Pair(
        name="cy from the bottom",
        a=a,
        b=changed(a, cy=H - K.cy),
        verdict=STRUCTURAL,
        alarm=True,
        kind=Kind.ORIGIN,
        says="bottom edge",
    )
    centred = changed(a, cx=K.cx - W / 2, cy=K.cy - H / 2)
    yield kind_of(
        name="principal point from the centre",
        a=a,
        b=centred,
        says="Use A",
        kind=Kind.FROM_CENTRE,
    )
    yield kind_of(
        name="the same in A",
        a=centred,
        b=a,
        says="Use B",
        kind=Kind.FROM_CENTRE,
    )
    up = changed(a, cx=K.cx - W / 2, cy=H / 2 - K.cy)
    yield kind_of(
        name="from the centre, y up",
        a=a,
        b=up,
        says="from the centre",
        kind=Kind.FROM_CENTRE,
    )
    swapped = lens(p1=LENS.p2, p2=LENS.p1)
    yield Pair(
        name="p1, p2 swapped", a=a, b=swapped, verdict=STRUCTURAL, alarm=True, kind=Kind.TANGENTIAL_SWAP
    )
    small = replace(LENS, p1=2e-5, p2=-1e-5)
    yield Pair(
        name="tiny p1, p2 swapped",
        a=camera(distortion=small),
        b=camera(distortion=replace(small, p1=-1e-5, p2=2e-5)),
        verdict=STRUCTURAL,
        alarm=False,
        kind=Kind.TANGENTIAL_SWAP,
    )
    yield Pair(
        name="sign of p1, p2",
        a=a,
        b=lens(p1=-LENS.p1, p2=-LENS.p2),
        verdict=STRUCTURAL,
        alarm=True,
        kind=Kind.TANGENTIAL_SIGN,
        says="opposite sign",
    )
    yield Pair(
        name="sign of p1 alone",
        a=a,
        b=lens(p1=-LENS.p1),
        verdict=STRUCTURAL,
        alarm=True,
        kind=Kind.TANGENTIAL_SIGN,
    )
    every = lens(**{name: -value for name, value in LENS.coefficients.items()})
    yield Pair(
        name="sign of the whole lens", a=a, b=every, verdict=STRUCTURAL, alarm=True, kind=Kind.DIRECTION
    )
    inverse = lens(k1=0.27, k2=0.09, k3=0.01)
    yield Pair(name="the inverse lens", a=a, b=inverse, verdict=STRUCTURAL, alarm=True, kind=Kind.DIRECTION)
    oblong = changed(a, fy=K.fx * 1.004)
    b = changed(a, fx=K.fx * 1.004, fy=K.fx)
    yield kind_of(
        name="fx, fy swapped",
        a=oblong,
        b=b,
        alarm=True,
        says="changed places",
        kind=Kind.FOCAL_SWAP,
    )
    nearly = changed(a, fy=K.fx * 1.0001), changed(a, fx=K.fx * 1.0001, fy=K.fx)
    yield kind_of(
        name="nearly equal fx, fy swapped",
        a=nearly[0],
        b=nearly[1],
        alarm=False,
        kind=Kind.FOCAL_SWAP,
    )
    equivalent = focal(24 / 8.8 - 1)
    yield Pair(
        name="35 mm equivalent", a=a, b=equivalent, verdict=STRUCTURAL, alarm=True, kind=Kind.EQUIVALENT_LEAK
    )


def frames() -> Iterator[Pair]:
    a = camera()
    K = a.intrinsics
    yield kind_of(
        name="turned by 180°",
        a=a,
        b=turned_180(),
        kind=Kind.TURNED,
        says="180°",
    )
    square = changed(a, image_size=(3648, 3648), cx=1850.0, cy=1800.0)  # type: ignore[arg-type]  # a size
    side = replace(
        changed(square, fx=K.fy, fy=K.fx, cx=3648 - 1800.0, cy=1850.0),
        distortion=replace(LENS, p1=LENS.p2, p2=-LENS.p1),
    )
    yield kind_of(name="a square turned by 90°", a=square, b=side, kind=Kind.TURNED, says="90° clockwise")
    yield kind_of(
        name="turned by 180°, measured twice",
        a=drawn(a, 1),
        b=drawn(turned_180(), 2),
        kind=Kind.TURNED,
        says="180°",
    )
    yield kind_of(
        name="turned by 90°",
        a=a,
        b=quarter(clockwise=True),
        kind=Kind.TURNED,
        says="90° clockwise",
    )
    yield kind_of(
        name="turned by 270°",
        a=a,
        b=quarter(clockwise=False),
        kind=Kind.TURNED,
        says="270° clockwise",
    )
    yield kind_of(
        name="mirrored",
        a=a,
        b=mirrored(),
        kind=Kind.MIRRORED,
        says="left to right",
    )
    yield kind_of(
        name="mirrored, measured",
        a=drawn(a, 3),
        b=drawn(mirrored(), 4),
        kind=Kind.MIRRORED,
    )
    yield kind_of(
        name="mirrored top to bottom",
        a=a,
        b=mirrored(sideways=False),
        kind=Kind.MIRRORED,
        says="top to bottom",
    )
    yield kind_of(
        name="resize",
        a=a,
        b=camera(size=(2736, 1824)),
        alarm=False,
        says="5472×3648 became 2736×1824 and the focal length went with it, × 0.5: the frame was resampled",
        kind=Kind.RESIZE,
    )
    yield kind_of(
        name="binning",
        a=a,
        b=camera(size=(1824, 1216)),
        alarm=False,
        says="its own size",
        kind=Kind.RESIZE,
    )
    drifted = focal(0.001).scaled((2736, 1824))
    yield kind_of(
        name="resize and f +0.1 %",
        a=a,
        b=drifted,
        alarm=True,
        says="resampled",
        kind=Kind.RESIZE,
    )
    lost = replace(camera(size=(2736, 1824)), distortion=replace(LENS, k3=0.0))
    yield kind_of(
        name="resize and k3 dropped",
        a=a,
        b=lost,
        kind=Kind.COEFFICIENT_LOST,
        says="k3 is missing",
    )
    wide = a.cropped((0, 285, 5472, 3078))
    yield kind_of(
        name="crop to 16:9",
        a=a,
        b=wide,
        kind=Kind.CROP,
        says="another part of the sensor",
    )
    yield kind_of(
        name="crop, resampled",
        a=a,
        b=wide.scaled((3840, 2160)),
        kind=Kind.CROP,
    )
    yield kind_of(
        name="digital zoom",
        a=a,
        b=focal(0.16),
        kind=Kind.FIELD,
        says="same size",
    )
    stretched = changed(a, fy=K.fy * 4 / 3)
    yield kind_of(
        name="stretched",
        a=a,
        b=stretched,
        kind=Kind.STRETCH,
        says="transcoded",
    )
    yield kind_of(
        name="another lens",
        a=a,
        b=other_lens(),
        kind=Kind.OTHER_CAMERA,
        says="another lens",
    )
    near = changed(other_lens(), fx=3690.0, fy=3689.0)
    yield kind_of(
        name="another lens of the same field",
        a=a,
        b=near,
        kind=Kind.OTHER_CAMERA,
        says="serial",
    )
    key = of_model(scattered(5, 0.004), "ILCE-7RM4")
    yield kind_of(
        name="another camera's key",
        a=a,
        b=key,
        kind=Kind.OTHER_CAMERA,
        says="ILCE-7RM4",
    )
    yield Pair(name="another key, same numbers", a=a, b=of_model(a, "P4R"), verdict=IDENTICAL, alarm=False)
    corrected = changed(camera(distortion=NoDistortion()), fx=K.fx * 0.999, fy=K.fy * 0.999, cx=K.cx + 0.4)
    yield kind_of(
        name="dewarp on",
        a=a,
        b=corrected,
        kind=Kind.DEWARP_ON,
        says="the camera corrects it",
    )
    yield kind_of(
        name="dewarp off",
        a=corrected,
        b=a,
        kind=Kind.DEWARP_OFF,
        says="no more",
    )


def units() -> Iterator[Pair]:
    a = camera()
    cases = (
        ("K in mm", W / 13.2, "millimetres"),
        ("normalised by the width", W, "by the width"),
        ("normalised by the height", H, "by the height"),
        ("normalised by the longer side", max(W, H), "the longer side"),
    )
    for name, by, says in cases:
        yield Pair(name=name, a=a, b=divided(by), verdict=None, alarm=False, says=says)
    yield Pair(name="A in mm", a=divided(W / 13.2), b=a, verdict=None, alarm=False, says="A: fx")
    yield Pair(
        name="both in mm",
        a=divided(W / 13.2),
        b=divided(W / 13.1),
        verdict=None,
        alarm=False,
        says="millimetres",
    )


def repeated() -> Iterator[Pair]:
    a = camera()
    yield Pair(name="calibrated twice", a=drawn(a, 11, 0.3), b=drawn(a, 12, 0.3), verdict=NOISE, alarm=False)
    loose = drawn(a, 13, 8), drawn(a, 14, 8)
    yield Pair(
        name="calibrated twice, badly",
        a=loose[0],
        b=loose[1],
        verdict=UNRESOLVED,
        alarm=False,
        says="calibrate better",
    )
    yield Pair(
        name="f +0.1 % measured",
        a=drawn(a, 15),
        b=drawn(focal(0.001), 16),
        verdict=DRIFT,
        alarm=True,
        says="Use B",
    )
    yield Pair(
        name="f +0.1 % within a variance factor of 80",
        a=replace(drawn(a, 17), quality=measured(a, kappa2=80.0).quality),
        b=replace(drawn(focal(0.001), 18), quality=measured(a, kappa2=80.0).quality),
        verdict=UNRESOLVED,
        alarm=False,
        says="the noise is large",
    )
    few = ("fx", "fy", "cx", "cy", "k1", "k2")
    lean = camera(distortion=BrownConrady(k1=LENS.k1, k2=LENS.k2, p1=0.0, p2=0.0, k3=0.0))
    k1 = replace(lean, distortion=replace(lean.distortion, k1=LENS.k1 + 0.006)) if lean.distortion else lean
    yield Pair(
        name="k1 by many sigmas, p and k3 fixed",
        a=drawn(lean, 19, 0.2, names=few),
        b=drawn(k1, 20, 0.2, names=few),
        verdict=DRIFT,
        alarm=True,
        says="Use B",
    )
    yield Pair(
        name="calibrated twice, p and k3 fixed",
        a=drawn(lean, 21, 0.2, names=few),
        b=drawn(lean, 22, 0.2, names=few),
        verdict=NOISE,
        alarm=False,
    )
    other = replace(drawn(a, 24, 0.3), distortion=as_rational(drawn(a, 24, 0.3)))
    yield Pair(name="other models, measured", a=drawn(a, 23, 0.3), b=other, verdict=NOISE, alarm=False)
    moved = drawn(focal(0.001), 25, 0.3)
    moved = replace(moved, distortion=as_rational(moved))
    yield Pair(name="other models, f +0.1 %", a=drawn(a, 26, 0.3), b=moved, verdict=DRIFT, alarm=True)
    std = dict(zip(NAMES, STD.tolist(), strict=True))
    silent_a, silent_b = (
        replace(drawn(one, seed, 0.5), quality=Quality(std=std))
        for one, seed in ((a, 27), (focal(0.003), 28))
    )
    yield Pair(name="standard deviations only, f +0.3 %", a=silent_a, b=silent_b, verdict=DRIFT, alarm=True)


def one_sided() -> Iterator[Pair]:
    a = camera()
    first, later = on(drawn(a, 31, 0.3), "2026-01-05"), on(silent(drawn(a, 32, 0.3)), "2026-06-05")
    yield Pair(name="covariance on one side", a=first, b=later, verdict=NOISE, alarm=False)
    moved = on(silent(drawn(focal(0.001), 33, 0.3)), "2026-06-05")
    yield Pair(
        name="covariance on one side, f +0.1 %",
        a=first,
        b=moved,
        verdict=DRIFT,
        alarm=True,
        says="1.5 times as uncertain",
    )
    yield Pair(name="the other side", a=on(moved, "2025-01-01"), b=first, verdict=DRIFT, alarm=True)
    undated = silent(drawn(focal(0.001), 33, 0.3))
    yield Pair(
        name="covariance on one side, same source",
        a=drawn(a, 31, 0.3),
        b=undated,
        verdict=DRIFT,
        alarm=True,
        says="no measured uncertainty explains",
    )
    yield Pair(
        name="no uncertainty, no dates",
        a=silent(scattered(1, 0)),
        b=silent(scattered(2, 0.0008)),
        verdict=DRIFT,
        alarm=True,
        says="calibrate",
    )
    yield Pair(
        name="self-calibrations of two flights",
        a=graded(scattered(1, 0), Grade.ADJUSTED, "2026-01-05"),
        b=graded(scattered(2, 0.0008), Grade.ADJUSTED, "2026-02-05"),
        verdict=UNRESOLVED,
        alarm=False,
        says="usually differ by as much",
    )
    yield Pair(
        name="self-calibrations too far apart",
        a=graded(scattered(1, 0), Grade.ADJUSTED, "2026-01-05"),
        b=graded(scattered(2, 0.015), Grade.ADJUSTED, "2026-02-05"),
        verdict=DRIFT,
        alarm=True,
    )
    tags = graded(changed(focal(0.012, camera(distortion=None)), cx=W / 2, cy=H / 2), Grade.DERIVED)
    yield Pair(
        name="EXIF against a board", a=measured(a), b=tags, verdict=UNRESOLVED, alarm=False, says="Use A"
    )
    yield Pair(
        name="one distortion unknown",
        a=a,
        b=camera(distortion=None),
        verdict=NEGLIGIBLE,
        alarm=False,
        says="B does not state the distortion",
    )
    yield Pair(
        name="both distortions unknown",
        a=camera(distortion=None),
        b=camera(distortion=None),
        verdict=IDENTICAL,
        alarm=False,
    )
    yield Pair(
        name="one distortion unknown, f +0.5 %",
        a=a,
        b=focal(0.005, camera(distortion=None)),
        verdict=DRIFT,
        alarm=True,
        says="only K was compared",
    )


PAIRS = tuple(pairs())
