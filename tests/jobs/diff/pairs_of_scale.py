"""More labelled pairs: a K of another image size, coefficients of another unit, and numbers that changed places."""

from __future__ import annotations

from collections.abc import Iterator

from calibrary.calibration import Grade
from calibrary.distortion import KannalaBrandt
from calibrary.jobs.diff.verdicts import Kind
from calibrary.records import replace
from tests.jobs.diff.cameras import LENS, camera, changed
from tests.jobs.diff.made import H, W, focal, graded, lens, measured
from tests.jobs.diff.pairs import DRIFT, IDENTICAL, Pair, kind_of


def other_sizes() -> Iterator[Pair]:
    a = camera()
    K = a.intrinsics
    half = changed(a, fx=K.fx / 2, fy=K.fy / 2, cx=K.cx / 2, cy=K.cy / 2)
    double = changed(a, fx=K.fx * 2, fy=K.fy * 2, cx=K.cx * 2, cy=K.cy * 2)
    kept = replace(a, intrinsics=replace(K, image_size=(2736, 1824)))
    cut = replace(a, intrinsics=replace(K, image_size=(5472, 3078)))
    for name, one, two, says in (
        ("the K of the half size", a, half, "0.5 times the numbers of A"),
        ("the half size in A", half, a, "Use B"),
        ("the K of the double size", a, double, "2 times the numbers of A"),
        ("half size, K not scaled", a, kept, "the very numbers of A"),
        ("half size first, K not scaled", kept, a, "Use B"),
        ("crop to 16:9, K not moved", a, cut, "not near the middle of its 5472×3078 frame"),
    ):
        yield kind_of(name=name, a=one, b=two, says=says, kind=Kind.OTHER_SIZE)


def other_units() -> Iterator[Pair]:
    a = camera()
    K = a.intrinsics
    for by, says in (
        (K.fx, "the focal length in pixels"),
        (8.87, "millimetres"),
        (13.2, "13.2^2, 13.2^4 and"),
    ):
        other = lens(k1=LENS.k1 / by**2, k2=LENS.k2 / by**4, k3=LENS.k3 / by**6)
        name = f"coefficients divided by {by}"
        yield kind_of(name=name, a=a, b=other, says=says, kind=Kind.OTHER_UNIT)
        yield kind_of(name=f"{name}, in A", a=other, b=a, says="Use B", kind=Kind.OTHER_UNIT)
    shares = changed(a, cx=K.cx / W, cy=K.cy / H)
    yield kind_of(name="cx, cy as shares", a=a, b=shares, says="shares of its width", kind=Kind.FROM_CENTRE)


def other_fields() -> Iterator[Pair]:
    a = camera()
    tags = graded(changed(focal(0.08, camera(distortion=None)), cx=W / 2, cy=H / 2), Grade.DERIVED)
    board = measured(a)
    yield kind_of(
        name="EXIF far from a board", a=tags, b=board, says="Use B, which is calibrated", kind=Kind.FIELD
    )
    yield kind_of(name="another zoom", a=a, b=focal(0.08), says="the mode that you fly", kind=Kind.FIELD)
    part, corner = a.cropped((816, 744, 3840, 2160)), a.cropped((1472, 648, 4000, 3000))
    yield kind_of(name="1:1 part of the sensor", a=a, b=part, says="change of kind", kind=Kind.CROP)
    yield kind_of(name="cut at the left and the top", a=a, b=corner, kind=Kind.CROP)


def changed_places() -> Iterator[Pair]:
    a = camera()
    K = a.intrinsics
    for name, b, kind, says in (
        ("k2 and k3 swapped", lens(k2=LENS.k3, k3=LENS.k2), Kind.ORDER, "k2 and k3 have each other's values"),
        (
            "the order k1 k2 k3 p1 p2",
            lens(p1=LENS.k3, p2=LENS.p1, k3=LENS.p2),
            Kind.ORDER,
            "in another order",
        ),
        ("cx and cy in each other's place", changed(a, cx=K.cy, cy=K.cx), Kind.CENTRE_SWAP, "changed places"),
        (
            "the centre for the principal point",
            changed(a, cx=W / 2, cy=H / 2),
            Kind.COEFFICIENT_LOST,
            "the principal point (2731.50, 1846.80) is missing in B",
        ),
    ):
        yield kind_of(name=name, a=a, b=b, kind=kind, says=says)
    for name, b, says in (
        ("k1 alone doubled", lens(k1=2 * LENS.k1), "only k1 differs"),
        ("fy set to fx", changed(a, fy=K.fx * 1.0008), "only fy differs"),
    ):
        yield Pair(name=name, a=a, b=b, verdict=DRIFT, alarm=True, says=says)
    fisheye = KannalaBrandt(k1=0.01, k2=-0.003, k3=0.0005, k4=0.0)
    one, two = camera(distortion=fisheye), camera(distortion=replace(fisheye, k1=0.011))
    yield Pair(name="a fisheye's k1", a=one, b=two, verdict=DRIFT, alarm=True, says="only k1 differs")
    rounded = {name: float(f"{getattr(K, name):.8g}") for name in ("fx", "fy", "cx", "cy")}
    yield Pair(name="single precision", a=a, b=changed(a, **rounded), verdict=IDENTICAL, alarm=False)


PAIRS_OF_SCALE = (*other_sizes(), *other_units(), *other_fields(), *changed_places())
