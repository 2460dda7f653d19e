"""camodocal's camera files, which VINS-Mono, VINS-Fusion and their kin read.

In the format's own words::

    %YAML:1.0
    ---
    model_type: PINHOLE              # PINHOLE_FULL, MEI, KANNALA_BRANDT, SCARAMUZZA
    camera_name: front
    image_width: 752
    image_height: 480
    distortion_parameters: { k1: -0.29, k2: 0.08, p1: 0.0002, p2: 0.00003 }
    projection_parameters: { fx: 461.2, fy: 459.8, cx: 362.7, cy: 248.5 }

PINHOLE_FULL adds k3 to k6 and is OpenCV's rational model. MEI has ``mirror_parameters: { xi: … }`` and calls its
focal lengths gamma1, gamma2, its principal point u0, v0. KANNALA_BRANDT has them all under
projection_parameters, mu, mv, u0, v0 beside k2, k3, k4, k5, which OpenCV counts from k1. VINS's own configuration
either contains a camera among its settings or names the camera's file under ``cam0_calib``.

Source: camodocal (``camera_models``), ``PinholeCamera.cc``, ``CataCamera.cc``, ``EquidistantCamera.cc``.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from calibrary.calibration import Calibration
from calibrary.distortion import Distortion, KannalaBrandt, Unified
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._opencv_lens import lens

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    remarks=(
        "coefficients are named; KANNALA_BRANDT's k2 to k5 are OpenCV's k1 to k4",
        "with MEI, K has gamma1 and gamma2, (1 + xi) times the focal lengths of the pinhole near the axis",
    ),
)
MODEL_KEYS = frozenset({"projection_parameters", "mirror_parameters", "poly_parameters"})

_REFERENCE = re.compile(r"cam\d+_calib")


def sniff(content: Content) -> Sniff | None:
    """The key model_type beside a model's parameters, or VINS's reference to such a file."""
    keys = set(content.yaml_keys)
    found = MODEL_KEYS & keys
    if "model_type" in keys and found:
        return Sniff(Sure.MAGIC, f"the keys model_type and {min(found)}")
    reference = next((key for key in content.yaml_keys if _REFERENCE.fullmatch(key)), None)
    return Sniff(Sure.SHAPE, f"the key {reference} of VINS") if reference else None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The file's camera, or every camera whose file it names."""
    tree = storage.load(data, source=context.name)
    if "model_type" in tree:
        return [_camera(tree, context)]
    references = [(key, node) for key, node in tree.entries() if _REFERENCE.fullmatch(key)]
    if not references:
        tree.fail("there is neither a model_type nor a cam0_calib")
    several = len(references) > 1
    return [_referred(key, node, context, several=several) for key, node in references]


def _referred(key: str, node: Node, context: ReadContext, *, several: bool) -> Calibration:
    """The camera of the file beside this one."""
    name = node.text()
    data = context.companion(name)
    if data is None:
        raise ParseError(
            f"it refers to {strict.shown(name)}, which is not beside it; read that file",
            source=context.name,
            place=key,
        )
    tree = storage.load(data, source=name)
    return _camera(tree, context, tag=name, sub_camera=key.removesuffix("_calib") if several else None)


def _camera(
    tree: Node, context: ReadContext, *, tag: str | None = None, sub_camera: str | None = None
) -> Calibration:
    model = tree["model_type"].text().upper()
    if model not in READERS:
        raise UnsupportedModelError(
            f"the model is {strict.shown(model)}, which has no counterpart here; calibrate the camera with "
            f"one of {', '.join(READERS)}, all of which camodocal fits to the same images",
            source=tree.source,
            place="model_type",
        )
    size = context.size(tree.image_size("image_width", "image_height"))
    native, distortion = READERS[model](tree)
    K = CONVENTION.intrinsics(native, size, source=tree.source)
    notes: tuple[str, ...] = ()
    if isinstance(distortion, Unified) and distortion.xi:
        near = K.fx / (1 + distortion.xi)
        notes = (
            f"K's fx is gamma1; near the axis the camera is a pinhole of {near:.6g} px, gamma1/(1 + xi)",
        )
    return context.calibration(K, distortion, name=sub_camera, tag=tag, notes=notes)


def _pinhole(tree: Node) -> tuple[Native, Distortion]:
    return _focal(tree, "fx", "fy", "cx", "cy"), lens(_coefficients(tree, "k1", "k2", "p1", "p2"))


def _full_pinhole(tree: Node) -> tuple[Native, Distortion]:
    values = _coefficients(tree, "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    return _focal(tree, "fx", "fy", "cx", "cy"), lens(values)


def _mei(tree: Node) -> tuple[Native, Distortion]:
    xi = tree["mirror_parameters"]["xi"]
    if xi.number() <= -1:
        xi.fail(f"{xi.number():g}, expected a number above −1")
    k1, k2, p1, p2 = _coefficients(tree, "k1", "k2", "p1", "p2")
    native = _focal(tree, "gamma1", "gamma2", "u0", "v0")
    return native, Unified(xi=xi.number(), k1=k1, k2=k2, p1=p1, p2=p2)


def _kannala_brandt(tree: Node) -> tuple[Native, Distortion]:
    node = tree["projection_parameters"]
    k1, k2, k3, k4 = (node[name].number() for name in ("k2", "k3", "k4", "k5"))
    return _focal(tree, "mu", "mv", "u0", "v0"), KannalaBrandt(k1=k1, k2=k2, k3=k3, k4=k4)


def _focal(tree: Node, *names: str) -> Native:
    fx, fy, cx, cy = (tree["projection_parameters"][name].number() for name in names)
    return Native(fx=fx, fy=fy, cx=cx, cy=cy)


def _coefficients(tree: Node, *names: str) -> tuple[float, ...]:
    return tuple(tree["distortion_parameters"][name].number() for name in names)


READERS: dict[str, Callable[[Node], tuple[Native, Distortion]]] = {
    "PINHOLE": _pinhole,
    "PINHOLE_FULL": _full_pinhole,
    "MEI": _mei,
    "KANNALA_BRANDT": _kannala_brandt,
}

FORMAT = Format(
    name="camodocal",
    title="camodocal and VINS camera",
    suffixes=(".yaml", ".yml"),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/hengli/camodocal",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
