"""What programs and people do to the numbers of one calibration: each is done to A, and B is compared with the result.

A conversion leaves all other numbers as they are, to the digits of a file, so one that gives every number of B is no
coincidence. None of them repairs anything.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, Literal, TypeAlias

from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.distortion import Distortion
from calibrary.jobs.diff.common_numbers import is_same
from calibrary.jobs.diff.lens_rays import bends_px
from calibrary.jobs.diff.verdicts import Kind
from calibrary.jobs.diff.wording import frame_size, listed, pixels
from calibrary.records import replace

Faulty: TypeAlias = Literal["A", "B"]

EXACT_PX: Final = 0.02
SAME_FOCAL: Final = 2e-5
"""Relative difference of focal lengths below which both are from one solve: a second solve from other frames would
not repeat a focal length to a tenth of its noise."""
SAME_TERM: Final = 1e-4
"""Relative difference of coefficients that the digits of a file explain."""

TANGENTIAL: Final = (("p1", "p2"), ("p0", "p1"))
"""Names of the tangential terms, by model."""
FEWEST_TERMS: Final = 2
"""Coefficients that have to agree before equal numbers in other places are no coincidence."""

NEAR_CENTRE: Final = 0.1
FROM_CENTRE: Final = 0.01
"""Tolerance, as a fraction of the frame's width, at which a principal point counted from the centre matches A's."""
ONE_RATIO: Final = 1e-3
"""Relative tolerance at which the ratios of fx, fy, cx and cy count as one common factor."""
OTHER_RATIO: Final = 0.02
"""Relative difference between that factor and the ratio of the image sizes above which K was not scaled with them."""
OFF_CENTRE: Final = 0.05
"""Fraction of a side: a principal point farther from the image centre belongs to another image size."""
AFFINE: Final = 0.01
"""A larger relative difference of fx and fy is of the shape of the pixels, which no program leaves out."""
ONE_UNIT: Final = 0.01
"""Relative tolerance at which the ratios of k1, k2 and k3 count as powers of one factor."""
LEAST_FACTOR: Final = 2.0
NEAR_FOCAL_MM: Final = 0.05
"""Relative tolerance between the nominal and the calibrated focal length in mm."""
POWERS: Final = {"k1": 2, "k2": 4, "k3": 6}


class Conversion(Struct, frozen=True, kw_only=True):
    """A conversion, and what it makes of the other side.

    Attributes:
        kind: of the change.
        reason: the meaning of the numbers that show it, with them unless ``shown`` has them.
        expected: what the converted side would then state.
        faulty: the side that is wrong; if none, B is the one that was converted.
        slack: share of the focal length and of the frame's width within which the numbers agree; 0 for the digits of
            a file.
        shown: the numbers that show it, where they show other conversions as well.
    """

    kind: Kind
    reason: str
    expected: Calibration
    faulty: Faulty | None = None
    slack: float = 0.0
    shown: str = ""


def conversions(a: Calibration, b: Calibration) -> Iterator[Conversion]:
    """Return those that give every number of ``b`` from ``a``, or of ``a`` from ``b``."""
    same_size = a.intrinsics.image_size == b.intrinsics.image_size
    if same_size:
        for one in (*_of_origin(a, b), *_of_places(a, b)):
            if is_made(b, one.expected):
                yield one
    sides: tuple[tuple[Faulty, Calibration, Calibration], ...] = (("B", a, b), ("A", b, a))
    for faulty, whole, wrong in sides:
        found = list(_of_another_size(whole, wrong, faulty))
        if same_size:
            for ways in (_from_centre, _of_unit, _lost):
                found += ways(whole, wrong, faulty)
        yield from (one for one in found if is_made(wrong, one.expected, one.slack))


def is_made(seen: Calibration, expected: Calibration, slack: float = 0.0) -> bool:
    """Whether every number is as expected; a distortion that one of the two does not state is not compared."""
    K, other = seen.intrinsics, expected.intrinsics
    focal, centre_px = slack or SAME_FOCAL, slack * K.image_size[0] or EXACT_PX
    of_focal = all(abs(x - y) <= focal * y for x, y in ((K.fx, other.fx), (K.fy, other.fy)))
    of_centre = all(
        abs(x - y) <= centre_px for x, y in ((K.cx, other.cx), (K.cy, other.cy), (K.skew, other.skew))
    )
    return of_focal and of_centre and _is_lens(seen.distortion, expected.distortion)


def _is_lens(one: Distortion | None, two: Distortion | None) -> bool:
    if one is None or two is None:
        return True
    if type(one) is not type(two):
        return False
    terms, others = one.coefficients, two.coefficients
    return terms.keys() == others.keys() and all(
        math.isclose(value, others[name], rel_tol=SAME_TERM) for name, value in terms.items()
    )


def _of_origin(a: Calibration, b: Calibration) -> Iterator[Conversion]:
    """K's numbers in each other's place, and principal points counted from elsewhere."""
    K, after = a.intrinsics, b.intrinsics
    (width, height), cx, cy = K.image_size, K.cx, K.cy
    change = f"cx, cy were {cx:.2f}, {cy:.2f} and are {after.cx:.2f}, {after.cy:.2f} px"
    both = "cx and cy both moved by {:+.3f} px and the focal length did not: one of the two counts"
    first, one = (
        "from the centre of the first pixel, the other from its corner",
        "pixels from 1, the other from 0",
    )
    moves = [
        (cx + by, cy + by, kind, "", f"{both.format(by)} {how}")
        for size, kind, how in ((0.5, Kind.HALF_PIXEL, first), (1.0, Kind.ORIGIN, one))
        for by in (size, -size)
    ]
    moves += [
        (width - cx, cy, Kind.ORIGIN, change, "cx counts from the right edge"),
        (cx, height - cy, Kind.ORIGIN, change, "cy counts from the bottom edge"),
        (width - cx, height - cy, Kind.ORIGIN, change, "both count from the opposite corner"),
        (cy, cx, Kind.CENTRE_SWAP, change, "they changed places"),
    ]
    for x, y, kind, shown, reason in moves:
        expected = replace(a, intrinsics=replace(K, cx=x, cy=y))
        yield Conversion(kind=kind, reason=reason, expected=expected, shown=shown)
    was, now = (f"{side.fx:.6g}, {side.fy:.6g}" for side in (K, after))
    yield Conversion(
        kind=Kind.FOCAL_SWAP,
        reason=f"fx, fy were {was} and are {now} px: they changed places",
        expected=replace(a, intrinsics=replace(K, fx=K.fy, fy=K.fx)),
    )


def _of_places(a: Calibration, b: Calibration) -> Iterator[Conversion]:
    """The same coefficients in other places, with other signs, or read for another model."""
    if a.distortion is None or b.distortion is None:
        return
    before, now = a.distortion.coefficients, b.distortion.coefficients
    one, two = ([value for value in lens.values() if value] for lens in (before, now))
    expected = replace(a, distortion=b.distortion)
    if type(a.distortion) is not type(b.distortion):
        if FEWEST_TERMS <= len(one) == len(two) and all(map(is_same, one, two)):
            models = f"{a.distortion.model} in A and {b.distortion.model} in B"
            reason = (
                f"the coefficients are the same to the last digit but of another model, {models}: one of the two was "
                "exported or read as what it is not"
            )
            yield Conversion(kind=Kind.OTHER_MODEL, reason=reason, expected=expected)
        return
    moved = [name for name in before if not is_same(before[name], now.get(name, math.nan))]
    if not moved or before.keys() != now.keys():
        return
    pair = tangential_names(a, b) or ()
    if all(map(is_same, sorted(one), sorted(two))) and len(one) == len(two) >= FEWEST_TERMS:
        places = f"{listed(moved)} have each other's values: the coefficients were read or written in another order"
        if {*moved} == {*pair}:
            stated = " and ".join(f"{name} = {before[name]:.4g}" for name in pair)
            places = f"{stated} changed places: Metashape's order against OpenCV's"
        kind = Kind.TANGENTIAL_SWAP if {*moved} == {*pair} else Kind.ORDER
        yield Conversion(kind=kind, reason=places, expected=expected)
    if all(is_same(before[name], -now[name]) for name in moved):
        stated = f"{', '.join(moved)} were {_values(before, moved)} and are {_values(now, moved)}"
        of_tangential = {*moved} <= {*pair}
        if of_tangential or len(moved) == len(one):
            what = "tangential terms" if of_tangential else "whole distortion"
            yield Conversion(
                kind=Kind.TANGENTIAL_SIGN if of_tangential else Kind.DIRECTION,
                reason=f"{stated}: the opposite sign of the {what}",
                expected=expected,
            )


def tangential_names(a: Calibration, b: Calibration) -> tuple[str, str] | None:
    """Names of the tangential terms that both have, by one meaning: their models share it, as OpenCV's do."""
    if a.distortion is None or b.distortion is None:
        return None
    one, two = a.distortion.coefficients, b.distortion.coefficients
    return next((pair for pair in TANGENTIAL if {*pair} <= one.keys() & two.keys()), None)


def _values(terms: dict[str, float], names: list[str]) -> str:
    return ", ".join(f"{terms[name]:.4g}" for name in names)


def _from_centre(whole: Calibration, wrong: Calibration, faulty: Faulty) -> Iterator[Conversion]:
    """A principal point near the corner: no image has it there, so all other numbers may differ."""
    K, counted = whole.intrinsics, wrong.intrinsics
    (width, height), cx, cy = K.image_size, K.cx, K.cy
    x, y = cx - width / 2, cy - height / 2
    if abs(x) > NEAR_CENTRE * width or abs(y) > NEAR_CENTRE * height:
        return
    from_centre = "count from the centre of the image, not from its corner"
    for at, what, slack in (
        ((cx / width, cy / height), "are probably shares of its width and height", FROM_CENTRE / width),
        ((x, y), from_centre, FROM_CENTRE),
        ((x, -y), from_centre, FROM_CENTRE),
    ):
        yield Conversion(
            kind=Kind.FROM_CENTRE,
            reason=f"cx, cy of {faulty} are {counted.cx:.2f}, {counted.cy:.2f} in a {frame_size(K.image_size)} frame: "
            f"they {what}",
            expected=replace(wrong, intrinsics=replace(counted, cx=at[0], cy=at[1])),
            faulty=faulty,
            slack=slack,
        )


def _lost(whole: Calibration, wrong: Calibration, faulty: Faulty) -> Iterator[Conversion]:
    """Coefficients, the affinity or the principal point set to what a program writes that does not know them."""
    K, bare = whole.intrinsics, wrong.intrinsics
    middle = (bare.image_size[0] / 2, bare.image_size[1] / 2)
    gone, left = [], K
    if bare.fx == bare.fy and 0 < abs(K.fx / K.fy - 1) < AFFINE:
        gone.append(f"the difference of fx and fy (b1 = {K.fx - K.fy:.4g})")
        nearest = min((K.fx, K.fy), key=lambda f: abs(f - bare.fx))
        left = replace(left, fx=nearest, fy=nearest)
    if K.skew and not bare.skew:
        gone.append(f"the skew (b2 = {K.skew:.4g})")
        left = replace(left, skew=0.0)
    if (bare.cx, bare.cy) == middle != (K.cx, K.cy):
        gone.append(f"the principal point ({K.cx:.2f}, {K.cy:.2f})")
        left = replace(left, cx=middle[0], cy=middle[1])
    lens, terms = whole.distortion, []
    if lens is not None and wrong.distortion is not None:
        now = wrong.distortion.coefficients
        stated = [name for name, value in lens.coefficients.items() if value]
        terms = [name for name in stated if not now.get(name)]
        if terms and terms == stated:
            yield from _lens_lost(whole, replace(wrong, intrinsics=left), faulty)
            return
        if terms:
            lens = replace(lens, **dict.fromkeys(terms, 0.0))
    if gone or terms:
        verb = "is" if len(gone) + len(terms) == 1 else "are"
        yield Conversion(
            kind=Kind.COEFFICIENT_LOST,
            reason=f"{listed([*terms, *gone])} {verb} missing in {faulty}; every other number is the same to the last "
            "digit",
            expected=replace(whole, intrinsics=left, distortion=lens),
            faulty=faulty,
        )


def _lens_lost(whole: Calibration, expected: Calibration, faulty: Faulty) -> Iterator[Conversion]:
    if any(one.provenance.kind == "image-metadata" or one.camera.capture_mode for one in (whole, expected)):
        # The camera may have corrected the image but written the K of the uncorrected image into its tags.
        return
    bends = bends_px(whole, expected)
    if bends is not None:
        yield Conversion(
            kind=Kind.DISTORTION_LOST,
            reason=f"{faulty} has no distortion where the other has {pixels(bends[0])} of it in the corners, and "
            "its K is the same to the last digit: it was lost on the way, or set to 0",
            expected=expected,
            faulty=faulty,
        )


def _of_another_size(whole: Calibration, wrong: Calibration, faulty: Faulty) -> Iterator[Conversion]:
    """K times one factor that is not that of the image sizes, so that the principal point is off the middle."""
    K, counted = whole.intrinsics, wrong.intrinsics
    factor = counted.fx / K.fx
    frames = [now / was for was, now in zip(K.image_size, counted.image_size, strict=True)]
    follows = all(abs(factor / frame - 1) <= OTHER_RATIO for frame in frames)
    if follows or not _off_centre(whole) <= OFF_CENTRE < _off_centre(wrong):
        return
    moved = replace(counted, fy=K.fy * factor, cx=K.cx * factor, cy=K.cy * factor)
    same = "the very numbers" if abs(factor - 1) <= ONE_RATIO else f"{factor:.4g} times the numbers"
    yield Conversion(
        kind=Kind.OTHER_SIZE,
        reason=f"fx, fy, cx and cy of {faulty} are {same} of {_other(faulty)}, and its principal point "
        f"({counted.cx:.0f}, {counted.cy:.0f}) is not near the middle of its {frame_size(counted.image_size)} frame: K "
        "counts in an image of another size",
        expected=replace(wrong, intrinsics=moved),
        faulty=faulty,
        slack=ONE_RATIO,
    )


def _off_centre(calibration: Calibration) -> float:
    K = calibration.intrinsics
    return max(abs(K.cx / K.image_size[0] - 0.5), abs(K.cy / K.image_size[1] - 0.5))


def _of_unit(whole: Calibration, wrong: Calibration, faulty: Faulty) -> Iterator[Conversion]:
    """Radial coefficients for radii in pixels or millimetres instead of in focal lengths."""
    if whole.distortion is None or type(whole.distortion) is not type(wrong.distortion):
        return
    one, two = whole.distortion.coefficients, wrong.distortion.coefficients
    names = [name for name in POWERS if one.get(name) and two.get(name)]
    ratios = [one[name] / two[name] for name in names]
    if len(names) < FEWEST_TERMS or min(ratios) <= 0:
        return
    factors = [ratio ** (1 / POWERS[name]) for name, ratio in zip(names, ratios, strict=True)]
    by = factors[0]
    if by < LEAST_FACTOR or max(factors) / min(factors) - 1 > ONE_UNIT:
        return
    divisors = listed([f"{by:.5g}^{POWERS[name]}" for name in names])
    yield Conversion(
        kind=Kind.OTHER_UNIT,
        reason=f"{listed(names)} of {faulty} are those of {_other(faulty)} divided by {divisors}"
        f"{_unit(whole, wrong, by)}: they are for lengths in another unit than the focal length",
        expected=replace(whole, distortion=wrong.distortion),
        faulty=faulty,
    )


def _other(faulty: Faulty) -> Faulty:
    return "A" if faulty == "B" else "B"


def _unit(a: Calibration, b: Calibration, by: float) -> str:
    if abs(by / a.intrinsics.fx - 1) <= ONE_UNIT:
        return ", the focal length in pixels"
    focals = [one.camera.focal_mm for one in (a, b) if one.camera.focal_mm]
    if any(math.isclose(by, focal, rel_tol=NEAR_FOCAL_MM) for focal in focals):
        return ", about the focal length in millimetres"
    return ""
