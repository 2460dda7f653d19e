"""What can happen to a calibration, each with what a comparison has to say: the rows and columns of a table of pairs.

A lens of any model is a row of ``lenses.csv``; each change that it can undergo makes a pair, and both sides of a pair
were written to and read from a file format that holds them, another one for each pair.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator
from functools import cache
from itertools import cycle
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Covariance, Grade, Intrinsics, Provenance, Quality
from calibrary.distortion import (
    MODELS,
    BrownConrady,
    Distortion,
    DoubleSphere,
    ExtendedUnified,
    KannalaBrandt,
    MetashapeFrame,
    NoDistortion,
    Rational,
    SplinedStereographic,
    Unified,
)
from calibrary.errors import CalibraryError
from calibrary.jobs.diff.comparison import ChangeVerdict
from calibrary.parsers.fit import refit
from calibrary.parsers.format import Format
from calibrary.records import replace

IDENTICAL, NOISE, NEGLIGIBLE, UNRESOLVED, DRIFT, STRUCTURAL = ChangeVerdict
Sides: TypeAlias = "tuple[Calibration, Calibration] | None"

FORMATS: Final = (
    "opencv_storage",
    "colmap_text",
    "agisoft_xml",
    "kalibr",
    "mrcal",
    "ros_camera_info",
    "opensfm",
    "stella_vslam",
    "numpy_npz",
    "euroc",
    "australis_report",
    "opf_calibrated_cameras",
    "micmac_xml",
    "ros_ini",
    "asp_tsai",
    "gyroflow",
    "transforms_json",
)
TANGENTIAL: Final = (("p1", "p2"), ("p0", "p1"))
EVEN: Final = frozenset(
    {"p0", "p1", "p2", "p3", "p4", "s0", "s1", "s2", "s3", "s4", "sx1", "sy1", "x0", "y0", "tau_x", "tau_y"}
)
"""Coefficients of even terms, which change sign if the frame is turned by 180°."""


class Change(NamedTuple):
    """A change, and what has to be said of it.

    Attributes:
        made: makes the two sides, or None if the lens cannot undergo it.
        verdicts: any of these is right; none stands for an input error.
        alarm: whether it needs attention; None if its size decides.
        cause: words of which one has to be shown.
    """

    made: Callable[[Calibration], Sides]
    verdicts: tuple[ChangeVerdict, ...]
    alarm: bool | None
    cause: tuple[str, ...]


class Row(NamedTuple):
    """A pair of the table."""

    lens: str
    change: str
    through: str
    a: Calibration
    b: Calibration


def lenses(path: Path) -> dict[str, Calibration]:
    """Read the lenses of a table, by name."""
    found = {}
    for name, model, width, height, *numbers, terms in csv.reader(path.read_text("utf-8").splitlines()[1:]):
        size = (int(width), int(height))
        fx, fy, cx, cy, skew = map(float, numbers)
        kind = MODELS[model]
        found[name] = Calibration(
            camera=CameraKey(image_size=size),
            intrinsics=Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, skew=skew, image_size=size),
            distortion=_lens(kind, [float(term) for term in terms.split()]),
            grade=Grade.CALIBRATED,
            provenance=Provenance(kind="checkerboard"),
        )
    return found


def _lens(kind: type[Distortion], terms: list[float]) -> Distortion:
    if kind is not SplinedStereographic:
        return kind(**dict(zip(kind.names(), terms, strict=True)))
    order, nx, ny, fov_x_deg = map(int, terms[:4])
    return kind(order=order, nx=nx, ny=ny, fov_x_deg=fov_x_deg, knots=tuple(terms[4:]))


def rows(path: Path) -> Iterator[Row]:
    """Make the pairs of the table."""
    formats = cycle(FORMATS)
    for lens, calibration in lenses(path).items():
        for change, how in CHANGES.items():
            sides = how.made(calibration)
            if sides is None:
                continue
            written, through = None, "memory"
            if not any(side.quality for side in sides):
                for through in (next(formats) for _ in FORMATS):
                    written = _through(sides, through)
                    if written is not None:
                        break
            yield Row(lens, change, through if written else "memory", *(written or sides))


def _through(sides: tuple[Calibration, Calibration], through: str) -> Sides:
    """Both sides as the format gives them back, if it holds them exactly."""
    found, record = [], _format(through)
    assert record.capacity is not None
    for side in sides:
        if type(side.distortion) not in record.capacity.models:
            return None
        try:
            data, _ = parsers.encode([side], record, max_error_px=1e-9)
            name = f"camera{record.suffixes[0]}"
            [copy] = parsers.decode(data, name=name, format=record, image_size=side.intrinsics.image_size)
        except CalibraryError:
            return None
        if (copy.distortion is None) is not (side.distortion is None):
            return None
        found.append(copy)
    return found[0], found[1]


@cache
def _format(name: str) -> Format:
    return next(one for one in parsers.formats() if one.name == name)


def with_k(calibration: Calibration, **numbers: float) -> Calibration:
    return replace(calibration, intrinsics=replace(calibration.intrinsics, **numbers))


def with_lens(calibration: Calibration, **numbers: float) -> Calibration:
    assert calibration.distortion is not None
    return replace(calibration, distortion=replace(calibration.distortion, **numbers))


def lens_of(calibration: Calibration) -> dict[str, float]:
    """The coefficients that vary by themselves."""
    assert calibration.distortion is not None
    is_splined = isinstance(calibration.distortion, SplinedStereographic)
    return {} if is_splined else calibration.distortion.coefficients


def bends(calibration: Calibration) -> bool:
    return not isinstance(calibration.distortion, NoDistortion)


@cache
def covariance(calibration: Calibration) -> Covariance:
    """What a good board gives: 0.15 px of noise in 2000 corners over the frame, seen from every side."""
    K, terms = calibration.intrinsics, lens_of(calibration)
    names = ("fx", "fy", "cx", "cy", *(name for name, value in terms.items() if value))
    width, height = K.image_size
    x, y = np.meshgrid(np.linspace(0, width, 13), np.linspace(0, height, 11))
    rays = calibration.unproject(np.column_stack([x.ravel(), y.ravel()]))
    rays = rays[np.isfinite(rays).all(axis=1)]
    columns = []
    for name in names:
        step = 1e-6 if name in terms else 1e-3
        sides = []
        for by in (step, -step):
            moved = (
                with_lens(calibration, **{name: terms[name] + by})
                if name in terms
                else with_k(calibration, **{name: getattr(K, name) + by})
            )
            sides.append(moved.project(rays))
        columns.append(((sides[0] - sides[1]) / (2 * step)).ravel())
    G = np.column_stack(columns)
    G = G[np.isfinite(G).all(axis=1)]
    scale = np.linalg.norm(G, axis=0)
    normal = (G / scale).T @ (G / scale) * (2000 / len(G) * 2)
    # A board's pose takes most of what a shift of the principal point does, which a board of many tilts leaves.
    normal += 1e-6 * np.trace(normal) * np.eye(len(names))
    C = 0.15**2 * np.linalg.inv(normal) / np.outer(scale, scale)
    return Covariance.from_matrix(names, C)


def measured(calibration: Calibration, like: Calibration | None = None) -> Calibration:
    return replace(calibration, quality=Quality(covariance=covariance(like or calibration)))


def drawn(
    calibration: Calibration, seed: int, like: Calibration | None = None, by: float = 1.0
) -> Calibration:
    """One more calibration of the same lens, with its noise."""
    C = covariance(like or calibration)
    error = np.random.default_rng(seed).multivariate_normal(np.zeros(len(C.names)), C.matrix * by**2)
    noise = dict(zip(C.names, error.tolist(), strict=True))
    terms = lens_of(calibration)
    moved = with_k(
        calibration,
        **{name: getattr(calibration.intrinsics, name) + noise[name] for name in ("fx", "fy", "cx", "cy")},
    )
    return with_lens(moved, **{name: terms[name] + by for name, by in noise.items() if name in terms})


def dated(calibration: Calibration, date: str) -> Calibration:
    return replace(calibration, provenance=replace(calibration.provenance, date=date))


def focal(calibration: Calibration, by: float) -> Calibration:
    K = calibration.intrinsics
    return with_k(calibration, fx=K.fx * by, fy=K.fy * by, skew=K.skew * by)


def edited(**by: Callable[[Intrinsics], float]) -> Callable[[Calibration], Sides]:
    def made(a: Calibration) -> Sides:
        return a, with_k(a, **{name: to(a.intrinsics) for name, to in by.items()})

    return made


def same(a: Calibration) -> Sides:
    return a, a


def rounded(a: Calibration) -> Sides:
    K = a.intrinsics
    cut = with_k(a, **{name: float(f"{getattr(K, name):.7g}") for name in ("fx", "fy", "cx", "cy")})
    return a, with_lens(cut, **{name: float(f"{value:.6g}") for name, value in lens_of(a).items()})


def other_model(a: Calibration) -> Sides:
    """The same lens in a model that gives the same pixels."""
    for target in (KannalaBrandt, MetashapeFrame):
        if isinstance(a.distortion, target) or not bends(a):
            continue
        for intrinsics in (a.intrinsics, _scaled_k(a, 1.25)):
            fitted = refit(a, target, intrinsics=intrinsics, focal_is_free=True)
            if fitted is not None and fitted[1].max_px < 0.1:
                return a, fitted[0]
    return None


def _scaled_k(a: Calibration, by: float) -> Intrinsics:
    return replace(a.intrinsics, fx=a.intrinsics.fx * by, fy=a.intrinsics.fy * by)


def resolved(a: Calibration) -> Sides:
    return dated(replace(drawn(a, 1), quality=measured(a).quality), "2026-01-05"), dated(
        replace(drawn(a, 2), quality=measured(a).quality), "2026-03-05"
    )


def resolved_silently(a: Calibration) -> Sides:
    return drawn(a, 3, by=0.2), drawn(a, 4, by=0.2)


def refocused(a: Calibration) -> Sides:
    b = focal(a, 1.004)
    return (
        dated(replace(drawn(a, 5), quality=measured(a).quality), "2026-01-05"),
        dated(replace(drawn(b, 6, a), quality=measured(a).quality), "2026-03-05"),
    )


def refocused_silently(a: Calibration) -> Sides:
    return drawn(a, 7, by=0.2), drawn(focal(a, 0.994), 8, a, by=0.2)


def zoomed(a: Calibration) -> Sides:
    return a, focal(a, 1.3)


def resized(a: Calibration) -> Sides:
    width, height = a.intrinsics.image_size
    return a, a.scaled((width // 2, height // 2))


def cropped(a: Calibration) -> Sides:
    width, height = a.intrinsics.image_size
    return a, a.cropped((0, height // 8, width, height - 2 * (height // 8)))


def cut_off_centre(a: Calibration) -> Sides:
    width, height = a.intrinsics.image_size
    return a, a.cropped((width // 8, height // 16, 3 * width // 4, 3 * height // 4))


def cropped_and_resized(a: Calibration) -> Sides:
    width, height = a.intrinsics.image_size
    part = a.cropped((0, height // 8, width // 4 * 4, height - 2 * (height // 8)))
    return a, part.scaled((part.intrinsics.image_size[0] // 2, part.intrinsics.image_size[1] // 2))


def turned(a: Calibration) -> Sides:
    K = a.intrinsics
    if isinstance(a.distortion, SplinedStereographic):
        return None
    width, height = K.image_size
    lens = {name: -value if name in EVEN else value for name, value in lens_of(a).items()}
    return a, with_lens(with_k(a, cx=width - K.cx, cy=height - K.cy), **lens)


def mirrored(a: Calibration) -> Sides:
    if not isinstance(a.distortion, BrownConrady | Rational | KannalaBrandt | DoubleSphere | Unified):
        return None
    K, terms = a.intrinsics, lens_of(a)
    lens = {"p2": -terms["p2"]} if "p2" in terms else {}
    return a, with_lens(with_k(a, cx=K.image_size[0] - K.cx), **lens)


def quarter(a: Calibration) -> Sides:
    K, terms = a.intrinsics, lens_of(a)
    width, height = K.image_size
    if (
        width == height
        or K.skew
        or not isinstance(a.distortion, BrownConrady | Rational | KannalaBrandt | Unified)
    ):
        return None
    lens = {"p1": terms["p2"], "p2": -terms["p1"]} if "p2" in terms else {}
    b = with_lens(a, **lens)
    new = Intrinsics(fx=K.fy, fy=K.fx, cx=height - K.cy, cy=K.cx, image_size=(height, width))
    return a, replace(b, intrinsics=new, camera=CameraKey(image_size=(height, width)))


def swapped_centre(a: Calibration) -> Sides:
    K = a.intrinsics
    return None if abs(K.cx - K.cy) < 20 else (a, with_k(a, cx=K.cy, cy=K.cx))


def swapped_focal(a: Calibration) -> Sides:
    K = a.intrinsics
    return None if K.fx == K.fy or K.skew else (a, with_k(a, fx=K.fy, fy=K.fx))


def _tangential(a: Calibration) -> tuple[str, str] | None:
    terms = lens_of(a)
    return next((pair for pair in TANGENTIAL if all(terms.get(name) for name in pair)), None)


def swapped_tangential(a: Calibration) -> Sides:
    pair = _tangential(a)
    if pair is None:
        return None
    terms = lens_of(a)
    return a, with_lens(a, **{pair[0]: terms[pair[1]], pair[1]: terms[pair[0]]})


def signed_tangential(a: Calibration) -> Sides:
    pair = _tangential(a)
    return None if pair is None else (a, with_lens(a, **{name: -lens_of(a)[name] for name in pair}))


def reordered(a: Calibration) -> Sides:
    """The coefficients in another program's order."""
    used = [name for name, value in lens_of(a).items() if value and abs(value) < 0.9]
    if len(used) < 3:
        return None
    values = [lens_of(a)[name] for name in used]
    return a, with_lens(a, **dict(zip(used, [values[0], values[-1], *values[1:-1]], strict=True)))


def without_affinity(a: Calibration) -> Sides:
    K = a.intrinsics
    return (a, with_k(a, fx=K.fy, skew=0.0)) if K.skew else None


def without_lens(a: Calibration) -> Sides:
    return (a, replace(a, distortion=NoDistortion())) if bends(a) else None


def without(a: Calibration) -> Sides:
    """The last coefficient that bends is missing."""
    terms = {name: value for name, value in lens_of(a).items() if value}
    if len(terms) < 3 or isinstance(a.distortion, Unified | DoubleSphere | ExtendedUnified):
        return None
    return a, with_lens(a, **{list(terms)[-1]: 0.0})


def as_other_model(a: Calibration) -> Sides:
    """The same coefficients under another model's name: a fisheye exported as a frame camera, or D as plumb_bob."""
    values = list(lens_of(a).values())
    if isinstance(a.distortion, KannalaBrandt):
        return a, replace(
            a, distortion=MetashapeFrame(**dict(zip(("k1", "k2", "k3", "k4"), values, strict=True)))
        )
    if isinstance(a.distortion, BrownConrady) and a.distortion.k3:
        k1, k2, p1, p2, _ = values
        lean = replace(a, distortion=replace(a.distortion, k3=0.0))
        return lean, replace(a, distortion=KannalaBrandt(k1=k1, k2=k2, k3=p1, k4=p2))
    return None


def divided(by: Callable[[Intrinsics], float]) -> Callable[[Calibration], Sides]:
    def made(a: Calibration) -> Sides:
        K = a.intrinsics
        f = by(K)
        return a, with_k(a, fx=K.fx / f, fy=K.fy / f, cx=K.cx / f, cy=K.cy / f, skew=0.0)

    return made


def half_k(a: Calibration) -> Sides:
    K = a.intrinsics
    return a, with_k(a, fx=K.fx / 2, fy=K.fy / 2, cx=K.cx / 2, cy=K.cy / 2, skew=0.0)


def other_lens(a: Calibration) -> Sides:
    K = a.intrinsics
    lens: Distortion = BrownConrady(k1=0.11, k2=-0.09, p1=0.0002, p2=-0.0001, k3=0.0)
    if isinstance(a.distortion, BrownConrady) or not bends(a):
        lens = KannalaBrandt(k1=-0.19, k2=0.11, k3=0.0, k4=0.0)
    f = 0.71 * K.image_size[0]
    return a, replace(
        with_k(a, fx=f, fy=f * 0.9995, cx=K.cx + 11.3, cy=K.cy - 7.9, skew=0.0), distortion=lens
    )


def thermal(a: Calibration) -> Sides:
    lens = BrownConrady(k1=-0.37, k2=0.19, p1=0.0009, p2=-0.0004, k3=0.0)
    size = (640, 512)
    if a.intrinsics.image_size[0] <= 1300:
        size = (160, 120)
    K = Intrinsics(
        fx=1.21 * size[0], fy=1.209 * size[0], cx=size[0] * 0.51, cy=size[1] * 0.492, image_size=size
    )
    return a, replace(a, intrinsics=K, distortion=lens, camera=CameraKey(image_size=size))


def dewarped(a: Calibration) -> Sides:
    if not bends(a):
        return None
    K = a.intrinsics
    f = _axial(a) * 0.998
    return a, replace(
        with_k(a, fx=f, fy=f, cx=K.cx + 0.3, cy=K.cy - 0.2, skew=0.0), distortion=NoDistortion()
    )


def _axial(a: Calibration) -> float:
    [one, two] = a.project(np.array([[0.0, 0.0, 1.0], [1e-4, 0.0, 1.0]]))
    return float(np.linalg.norm(two - one)) / 1e-4


def warped(a: Calibration) -> Sides:
    sides = dewarped(a)
    return None if sides is None else (sides[1], sides[0])


def in_pixels(a: Calibration) -> Sides:
    """Radial coefficients for radii in pixels."""
    if not isinstance(a.distortion, BrownConrady | MetashapeFrame) or not a.distortion.k3:
        return None
    f = a.intrinsics.fx
    return a, with_lens(a, k1=a.distortion.k1 / f**2, k2=a.distortion.k2 / f**4, k3=a.distortion.k3 / f**6)


def unknown_lens(a: Calibration) -> Sides:
    return (a, replace(a, distortion=None)) if bends(a) else None


def tags(a: Calibration) -> Sides:
    """What the tags of an image give: a nominal focal length, the centre, no distortion."""
    K = a.intrinsics
    width, height = K.image_size
    f = _axial(a) * 1.011
    b = replace(
        with_k(a, fx=f, fy=f, cx=width / 2, cy=height / 2, skew=0.0), distortion=None, grade=Grade.DERIVED
    )
    return measured(a), replace(b, provenance=Provenance(kind="image-metadata"))


def renewed_focal(a: Calibration) -> Sides:
    """Fx and fy anew with all else held, as an adjustment does that was told to."""
    K = a.intrinsics
    return a, with_k(a, fx=K.fx * 1.0031, fy=K.fy * 1.0031 + 0.2)


def with_deviations(a: Calibration) -> Sides:
    """Two solves that state σ of K alone, and differ by less than that."""
    if len(lens_of(a)) < 2:
        return None
    C = covariance(a)
    std = {name: 60 * C.std[name] for name in ("fx", "fy", "cx", "cy")}
    one, two = (dated(drawn(a, seed, by=20), f"2026-0{seed - 8}-05") for seed in (9, 10))
    return replace(one, quality=Quality(std=std)), replace(two, quality=Quality(std=std))


CHANGES: Final = {
    "the same": Change(same, (IDENTICAL,), False, ("same",)),
    "fewer digits": Change(rounded, (IDENTICAL, NEGLIGIBLE), False, ("below the limits", "same")),
    "another model of the same lens": Change(
        other_model, (IDENTICAL, NEGLIGIBLE), False, ("same lens in", "below", "same")
    ),
    "solved twice": Change(resolved, (NOISE, NEGLIGIBLE), False, ("within noise", "below the limits")),
    "solved twice, without σ": Change(resolved_silently, (NEGLIGIBLE,), False, ("below the limits",)),
    "σ of K alone, moved by less": Change(
        with_deviations, (UNRESOLVED, NEGLIGIBLE), False, ("coefficients", "below")
    ),
    "focus": Change(refocused, (DRIFT,), True, ("focus",)),
    "focus, without σ": Change(refocused_silently, (DRIFT,), True, ("focus",)),
    "zoom": Change(zoomed, (STRUCTURAL,), True, ("zoom",)),
    "resized": Change(resized, (STRUCTURAL,), False, ("resampled",)),
    "crop": Change(cropped, (STRUCTURAL,), True, ("another part of the sensor",)),
    "crop off the centre": Change(cut_off_centre, (STRUCTURAL,), True, ("another part of the sensor",)),
    "crop, resized": Change(cropped_and_resized, (STRUCTURAL,), True, ("another part of the sensor",)),
    "turned by 180°": Change(turned, (STRUCTURAL,), True, ("180°",)),
    "mirrored": Change(mirrored, (STRUCTURAL,), True, ("mirrored",)),
    "turned by 90°": Change(quarter, (STRUCTURAL,), True, ("90°",)),
    "half a pixel": Change(
        edited(cx=lambda K: K.cx + 0.5, cy=lambda K: K.cy + 0.5), (STRUCTURAL,), True, ("first pixel",)
    ),
    "pixels from 1": Change(
        edited(cx=lambda K: K.cx + 1, cy=lambda K: K.cy + 1), (STRUCTURAL,), True, ("from 1",)
    ),
    "cy from the bottom": Change(
        edited(cy=lambda K: K.image_size[1] - K.cy), (STRUCTURAL,), True, ("bottom",)
    ),
    "centre from the middle": Change(
        edited(cx=lambda K: K.cx - K.image_size[0] / 2, cy=lambda K: K.cy - K.image_size[1] / 2),
        (STRUCTURAL,),
        True,
        ("from the centre",),
    ),
    "cx and cy exchanged": Change(swapped_centre, (STRUCTURAL,), None, ("changed places",)),
    "fx and fy exchanged": Change(swapped_focal, (STRUCTURAL,), None, ("changed places",)),
    "p1 and p2 exchanged": Change(swapped_tangential, (STRUCTURAL,), None, ("changed places",)),
    "sign of p1 and p2": Change(signed_tangential, (STRUCTURAL,), None, ("sign",)),
    "order of the coefficients": Change(reordered, (STRUCTURAL,), None, ("order",)),
    "b1 and b2 lost": Change(without_affinity, (STRUCTURAL,), None, ("b1",)),
    "the lens lost": Change(without_lens, (STRUCTURAL,), True, ("lost",)),
    "a coefficient lost": Change(without, (STRUCTURAL,), None, ("missing",)),
    "read as another model": Change(as_other_model, (STRUCTURAL,), None, ("another model",)),
    "times π/180": Change(divided(lambda _: 180 / math.pi), (), False, ("π/180",)),
    "in millimetres": Change(divided(lambda K: K.image_size[0] / 13.2), (), False, ("millimetres",)),
    "by the width": Change(divided(lambda K: K.image_size[0]), (), False, ("by the width",)),
    "the K of half the size": Change(half_k, (STRUCTURAL,), True, ("another size",)),
    "coefficients for pixels": Change(in_pixels, (STRUCTURAL,), True, ("another unit",)),
    "another lens": Change(other_lens, (STRUCTURAL,), True, ("another lens",)),
    "thermal": Change(thermal, (STRUCTURAL,), True, ("another camera",)),
    "dewarp on": Change(dewarped, (STRUCTURAL,), True, ("camera corrects it",)),
    "dewarp off": Change(warped, (STRUCTURAL,), True, ("corrects no more",)),
    "stretched": Change(edited(fy=lambda K: K.fy * 4 / 3), (STRUCTURAL,), True, ("stretched",)),
    "cx by hand": Change(edited(cx=lambda K: K.cx + 0.02 * K.image_size[0]), (DRIFT,), True, ("edited",)),
    "fx and fy anew": Change(renewed_focal, (DRIFT,), True, ("held fixed",)),
    "no lens stated": Change(
        unknown_lens, (NEGLIGIBLE, IDENTICAL), False, ("does not state the distortion",)
    ),
    "tags against a board": Change(tags, (UNRESOLVED,), False, ("does not state the distortion",)),
}
