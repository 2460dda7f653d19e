"""Shared by OPF's two camera documents: the document structure and the optics of a sensor.

A sensor's ``internals``, as in the specification::

    perspective  principal_point_px, focal_length_px, radial_distortion [R1, R2, R3],
                 tangential_distortion [T1, T2]
    fisheye      principal_point_px, affine [c, d, e, f], polynomial [p0, p1, p2, p3]
    spherical    principal_point_px

(0, 0) is the top left corner of the top left pixel. R and T are OpenCV's k1 k2 k3 and p1 p2. A fisheye's
polynomial maps the angle from the axis, t = 2θ/π, to a radius, and [c d; e f] maps that to pixels: fx =
2/π·c, skew = 2/π·d, fy = 2/π·f.

Sources: OPF specification 1.0, "Input cameras" and "Calibrated cameras"; Pix4D, "Camera internals for fisheye
lens".
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from urllib.parse import unquote

from calibrary.calibration import ImageSize, Intrinsics
from calibrary.distortion import BrownConrady, Distortion, FisheyePolynomial, NoDistortion, required
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Sniff, Sure
from calibrary.records import Json

CONVENTION = Convention(
    origin=Origin.CORNER,
    coefficients=("R1", "R2", "R3", "T1", "T2"),
    remarks=(
        "a fisheye's polynomial p0 p1 p2 p3 takes 2θ/π, the angle from the axis in right angles, to the radius",
        "a fisheye's focal length is 2/π of its affine matrix",
    ),
)
PROJECT_MARK = "application/opf-project+json"
MOST_POWERS = 5
"""Most coefficients of a fisheye's polynomial, up to p4 as in calibrary's model."""

RIGHT_ANGLE = math.pi / 2


def sniffed(content: Content, mark: str) -> Sniff | None:
    """Recognise a document with the ``format`` ``mark``."""
    document = content.json
    if isinstance(document, dict) and document.get("format") == mark:
        return Sniff(Sure.MAGIC, f"its format is '{mark}'")
    return None


def sensors(document: Node, mark: str) -> tuple[Node, ...]:
    """The sensors of a document.

    Raises:
        ParseError: it is not a document of this format, or contains no sensor.
        UnsupportedModelError: it has a later major version.
    """
    found = document["format"].text()
    if found != mark:
        raise ParseError(f"its format is {strict.shown(found)}, expected '{mark}'", source=document.source)
    version = document["version"].text()
    if version.partition(".")[0] not in {"0", "1"}:
        raise UnsupportedModelError(
            f"it is of version {strict.shown(version)}; 0 and 1 are known",
            source=document.source,
            place="version",
        )
    items = document["sensors"].items()
    if not items:
        document["sensors"].fail("there is no sensor")
    return items


def resources(project: Node, mark: str) -> Iterator[str]:
    """Where a project's documents of the format ``mark`` are, relative to the project."""
    for item in project["items"].items():
        for resource in item["resources"].items():
            if resource["format"].value == mark:
                yield unquote(resource["uri"].text())


def labels(items: tuple[Node, ...], names: Mapping[int, str]) -> list[str | None]:
    """Distinct labels of a document's sensors: names, with the id if names are equal; None for a single sensor."""
    if len(items) == 1:
        return [None]
    ids = [identity(item) for item in items]
    called = [names.get(number, "") for number in ids]
    bearers = Counter(called)
    return [
        name if name and bearers[name] == 1 else f"{name or 'sensor'} {number}"
        for name, number in zip(called, ids, strict=True)
    ]


def identity(sensor: Node) -> int:
    """A sensor's id, a 64-bit integer, which a float would round.

    Raises:
        ParseError: it is not an integer.
    """
    value = sensor["id"].value
    if not isinstance(value, int) or isinstance(value, bool):
        sensor["id"].fail("this is not a whole number, as an id is")
    return value


def image_size(sensor: Node) -> ImageSize:
    """The image size of an input camera.

    Raises:
        ParseError: it is not an image size.
    """
    node = sensor["image_size_px"]
    width, height = node.numbers(2)
    return strict.image_size(width, height, source=node.source, place=node.place)


def extras(sensor: Node, prefix: str, known: frozenset[str]) -> tuple[tuple[str, str], ...]:
    """The other keys of a sensor, as JSON."""
    return tuple(
        (prefix + key, json.dumps(value.value)) for key, value in sensor.entries() if key not in known
    )


def optics(node: Node, size: ImageSize) -> tuple[Intrinsics, Distortion]:
    """K and distortion of a sensor's ``internals``.

    Raises:
        ParseError: the internals are invalid.
        UnsupportedModelError: a spherical camera, or an affine matrix or polynomial without a counterpart.
    """
    kind = node["type"].text()
    if kind == "perspective":
        return _perspective(node, size)
    if kind == "fisheye":
        return _fisheye(node, size)
    raise UnsupportedModelError(
        f"a {strict.shown(kind)} camera has no K; expected perspective or fisheye",
        source=node.source,
        place=node["type"].place,
    )


def internals(K: Intrinsics, distortion: Distortion | None) -> dict[str, Json]:
    """The ``internals`` of a camera."""
    native = CONVENTION.native(K)
    centre: dict[str, Json] = {"principal_point_px": [native.cx, native.cy]}
    if isinstance(distortion, FisheyePolynomial):
        k2, k3, k4 = distortion.coefficients.values()
        polynomial: list[Json] = [0.0, 1.0, k2 * RIGHT_ANGLE, k3 * RIGHT_ANGLE**2]
        affine: list[Json] = [
            native.fx * RIGHT_ANGLE,
            native.skew * RIGHT_ANGLE,
            0.0,
            native.fy * RIGHT_ANGLE,
        ]
        return {
            "type": "fisheye",
            **centre,
            "is_symmetric_affine": native.fx == native.fy and not native.skew,
            "affine": affine,
            "polynomial": [*polynomial, k4 * RIGHT_ANGLE**3] if k4 else polynomial,
            "is_p0_zero": True,
        }
    brown = required(distortion, BrownConrady)
    return {
        "type": "perspective",
        **centre,
        "focal_length_px": native.fx,
        "radial_distortion": [brown.k1, brown.k2, brown.k3],
        "tangential_distortion": [brown.p1, brown.p2],
    }


def _perspective(node: Node, size: ImageSize) -> tuple[Intrinsics, Distortion]:
    focal = node["focal_length_px"].number()
    cx, cy = node["principal_point_px"].numbers(2)
    k1, k2, k3 = node["radial_distortion"].numbers(3)
    p1, p2 = node["tangential_distortion"].numbers(2)
    K = CONVENTION.intrinsics(Native(fx=focal, fy=focal, cx=cx, cy=cy), size, source=node.source)
    if not any((k1, k2, k3, p1, p2)):
        return K, NoDistortion()
    return K, BrownConrady(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3)


def _fisheye(node: Node, size: ImageSize) -> tuple[Intrinsics, Distortion]:
    cx, cy = node["principal_point_px"].numbers(2)
    c, d, e, f = node["affine"].numbers(4)
    if e:
        raise UnsupportedModelError(
            f"the affine matrix is rotated (e = {e:g}), which K has no place for",
            source=node.source,
            place=node["affine"].place,
        )
    polynomial = node["polynomial"].numbers()
    while len(polynomial) > 2 and not polynomial[-1]:
        polynomial = polynomial[:-1]
    if not 2 <= len(polynomial) <= MOST_POWERS or polynomial[0] or not polynomial[1] > 0:
        raise UnsupportedModelError(
            f"the polynomial is {', '.join(f'{p:g}' for p in polynomial[: MOST_POWERS + 1])}; expected p0 = 0, "
            f"p1 > 0 and nothing past p{MOST_POWERS - 1}",
            source=node.source,
            place=node["polynomial"].place,
        )
    p1, *rest = polynomial[1:]
    k2, k3, k4 = (p / p1 / RIGHT_ANGLE**power for power, p in enumerate([*rest, 0.0, 0.0, 0.0][:3], start=1))
    scale = p1 / RIGHT_ANGLE
    native = Native(fx=c * scale, fy=f * scale, cx=cx, cy=cy, skew=d * scale)
    K = CONVENTION.intrinsics(native, size, source=node.source)
    return K, FisheyePolynomial(k2=k2, k3=k3, k4=k4)
