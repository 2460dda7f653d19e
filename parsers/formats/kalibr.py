"""Kalibr's camera chain, ``camchain*.yaml``: the output of ``kalibr_calibrate_cameras``.

In the format's own words::

    cam0:
      camera_model: pinhole                                  # omni, eucm, ds
      intrinsics: [3650.1, 3649.8, 2736.2, 1824.7]           # fu, fv, pu, pv
      distortion_model: radtan                               # equidistant, fov, none
      distortion_coeffs: [-0.0125, 0.0231, -0.0004, 0.0008]  # k1, k2, p1, p2
      resolution: [5472, 3648]
      rostopic: /cam0/image_raw
      T_cn_cnm1: …                                           # from the camera before to this one
    cam1: …

The parameters of a camera model come *before* the focal lengths: omni has xi, eucm alpha, beta and ds xi, alpha first.
omni multiplies by the generalised focal length of Mei's model, so near its axis the camera is a pinhole of fu/(1 + xi);
the same holds for ds. A single camera may be without the ``cam0`` around it, and people call cameras otherwise.
OpenVINS keeps the format under OpenCV's directive ``%YAML:1.0``.

Source: Kalibr, "Supported models" and "YAML formats" of its wiki; ``kalibr_common/ConfigReader.py``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence

from calibrary.calibration import Calibration
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    DoubleSphere,
    ExtendedUnified,
    FieldOfView,
    KannalaBrandt,
    NoDistortion,
    Unified,
)
from calibrary.errors import UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._json_text import restored
from calibrary.parsers.formats._opencv_lens import BrownWithoutK3
from calibrary.parsers.formats._yaml_text import flow, scalar

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2"),
    remarks=(
        "equidistant's four are k1, k2, k3, k4",
        "xi, alpha and beta come before the focal lengths",
        "with omni and ds, K has the file's focal lengths, (1 + xi) times those of the pinhole near the axis",
    ),
)
SHAPES = {"pinhole": (), "omni": ("xi",), "eucm": ("alpha", "beta"), "ds": ("xi", "alpha")}
"""The camera models, each with what comes before fu, fv, pu, pv."""
COUNTS = {"radtan": 4, "equidistant": 4, "fov": 1, "none": 0}
OWN_KEYS = frozenset({"camera_model", "intrinsics", "distortion_model", "distortion_coeffs", "resolution"})
PREFIX = "kalibr/"
MAX_CAMERAS = 1000

_CAMERA = re.compile(r"cam\d+")
_UNDER = re.compile(r"^[ \t]+(camera_model|distortion_coeffs|intrinsics)[ \t]*:", re.MULTILINE)


def sniff(content: Content) -> Sniff | None:
    """The key camera_model with coefficients under Kalibr's own name for them, in a cam0 or alone."""
    keys = content.yaml_keys
    if {"camera_model", "distortion_coeffs", "intrinsics"} <= set(keys):
        return Sniff(Sure.MAGIC, "the keys camera_model, intrinsics and distortion_coeffs")
    under = set(_UNDER.findall(content.text or ""))
    camera = next((key for key in keys if _CAMERA.fullmatch(key)), None)
    if camera and "camera_model" in under:
        return Sniff(Sure.MAGIC, f"the key {camera} and camera_model under it")
    if {"camera_model", "distortion_coeffs", "intrinsics"} <= under:
        return Sniff(Sure.MAGIC, "a key with camera_model, intrinsics and distortion_coeffs under it")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the chain, in the file's order."""
    tree = storage.load(data, source=context.name)
    if "camera_model" in tree:
        return [camera_of(None, tree, context, several=False)]
    named = [(key, node) for key, node in tree.entries() if _CAMERA.fullmatch(key) or "camera_model" in node]
    if not named:
        tree.fail("there is neither a cam0 nor a camera_model")
    if len(named) > MAX_CAMERAS:
        tree.fail(f"{len(named)} cameras, expected at most {MAX_CAMERAS}")
    return [camera_of(key, node, context, several=len(named) > 1) for key, node in named]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """Kalibr's keys, cam0 first; the transforms between cameras go back where the chain's order is kept."""
    names = [item.camera.sub_camera for item in calibrations]
    in_order = names == [f"cam{index}" for index in range(len(calibrations))] or len(names) == 1
    lines: list[str] = []
    for index, item in enumerate(calibrations):
        lines.append(f"cam{index}:")
        lines += [f"  {row}" for row in _rows(item, index, in_order=in_order)]
    return "".join(f"{line}\n" for line in lines).encode()


def camera_of(name: str | None, node: Node, context: ReadContext, *, several: bool) -> Calibration:
    """The camera of one mapping of the chain."""
    # The last key first: a file cut short before it has no camera model that could be unknown.
    width, height = node["resolution"].numbers(2)
    size = context.size(strict.image_size(width, height, place=node["resolution"].place))
    model = node["camera_model"].text()
    if model not in SHAPES:
        raise UnsupportedModelError(
            f"the camera model is {strict.shown(model)}, which has no counterpart here; "
            f"expected {', '.join(SHAPES)}",
            place=node["camera_model"].place,
        )
    names = SHAPES[model]
    *special, fu, fv, pu, pv = node["intrinsics"].numbers(len(names) + 4)
    distortion = _distortion(model, dict(zip(names, special, strict=True)), node)
    K = CONVENTION.intrinsics(Native(fx=fu, fy=fv, cx=pu, cy=pv), size)
    notes: tuple[str, ...] = ()
    if isinstance(distortion, Unified | DoubleSphere) and distortion.xi:
        near = K.fx / (1 + distortion.xi)
        notes = (
            f"K's fx is Kalibr's fu; near the axis the camera is a pinhole of {near:.6g} px, fu/(1 + xi)",
        )
    return context.calibration(
        K,
        distortion,
        name=name if several else None,
        tag=name,
        notes=notes,
        extras=tuple(
            (PREFIX + key, json.dumps(child.value, ensure_ascii=False))
            for key, child in node.entries()
            if key not in OWN_KEYS
        ),
    )


def _distortion(model: str, special: dict[str, float], node: Node) -> Distortion:
    kind = node["distortion_model"].text()
    if kind not in COUNTS:
        raise UnsupportedModelError(
            f"the distortion model is {strict.shown(kind)}, which has no counterpart here; "
            f"expected {', '.join(COUNTS)}",
            source=node.source,
            place=node["distortion_model"].place,
        )
    values = node["distortion_coeffs"].numbers(COUNTS[kind])
    _check_range(special, node["intrinsics"], lowest_xi=0.0 if model == "omni" else -1.0)
    if model == "omni" and kind in {"radtan", "none"}:
        return Unified(**special, **dict(zip(("k1", "k2", "p1", "p2"), values, strict=False)))
    if model == "eucm" and kind == "none":
        return ExtendedUnified(**special)
    if model == "ds" and kind == "none":
        return DoubleSphere(**special)
    if model != "pinhole":
        raise UnsupportedModelError(
            f"a camera model {model} with distortion {kind} has no counterpart here, and Kalibr has none either",
            source=node.source,
            place=node["distortion_model"].place,
        )
    return _pinhole(kind, values)


def _check_range(special: dict[str, float], node: Node, *, lowest_xi: float) -> None:
    alpha, beta, xi = special.get("alpha", 0.0), special.get("beta", 1.0), special.get("xi", 0.0)
    if not (0 <= alpha <= 1 and beta > 0 and (xi >= 0 or xi > lowest_xi)):
        listed = ", ".join(f"{name} = {value:g}" for name, value in special.items())
        node.fail(f"{listed}, expected 0 ≤ alpha ≤ 1, beta > 0 and xi from 0 (for ds from above −1)")


def _pinhole(kind: str, values: tuple[float, ...]) -> Distortion:
    if kind == "equidistant":
        return KannalaBrandt(**dict(zip(KannalaBrandt.names(), values, strict=True)))
    if not any(values):
        return NoDistortion()
    if kind == "fov":
        return FieldOfView(omega=values[0])
    return BrownConrady(**dict(zip(("k1", "k2", "p1", "p2"), values, strict=True)))


def _rows(calibration: Calibration, index: int, *, in_order: bool) -> Iterator[str]:
    """One camera's lines; what makes it complete comes last."""
    K, lens = calibration.intrinsics, calibration.distortion or NoDistortion()
    model, special, kind, values = _model_names(lens)
    native = CONVENTION.native(K)
    extras = {key.removeprefix(PREFIX): text for key, text in calibration.extras if key.startswith(PREFIX)}
    if not in_order:
        extras.pop("T_cn_cnm1", None)
        extras.pop("cam_overlaps", None)
    # Kalibr's own programs refuse a camera without one.
    extras.setdefault("rostopic", json.dumps(f"/cam{index}/image_raw"))
    for key, text in extras.items():
        yield f"{key if key.isidentifier() else scalar(key)}: {scalar(restored(text))}"
    yield f"camera_model: {model}"
    yield f"distortion_model: {kind}"
    yield f"distortion_coeffs: {flow(values)}"
    yield f"intrinsics: {flow([*special, native.fx, native.fy, native.cx, native.cy])}"
    yield f"resolution: [{K.image_size[0]}, {K.image_size[1]}]"


def _model_names(lens: Distortion) -> tuple[str, list[float], str, list[float]]:
    """Camera model, its special numbers, distortion model, its coefficients."""
    values = list(lens.coefficients.values())
    if isinstance(lens, KannalaBrandt):
        return "pinhole", [], "equidistant", values
    if isinstance(lens, FieldOfView):
        return "pinhole", [], "fov", values
    if isinstance(lens, Unified):
        if lens.xi < 0:
            raise UnsupportedModelError(f"xi is {lens.xi:g}, and Kalibr's omni camera has one from 0 on")
        return (
            ("omni", values[:1], "radtan", values[1:])
            if any(values[1:])
            else ("omni", values[:1], "none", [])
        )
    if isinstance(lens, ExtendedUnified):
        return "eucm", values, "none", []
    if isinstance(lens, DoubleSphere):
        return "ds", values, "none", []
    # Not every program that reads chains knows a pinhole without distortion.
    return "pinhole", [], "radtan", values or [0.0] * 4


FORMAT = Format(
    name="kalibr",
    title="Kalibr camera chain",
    suffixes=(".yaml", ".yml"),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/ethz-asl/kalibr/wiki/yaml-formats",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(
        models=(
            NoDistortion,
            BrownWithoutK3,
            KannalaBrandt,
            Unified,
            ExtendedUnified,
            DoubleSphere,
            FieldOfView,
        ),
        several_cameras=True,
    ),
)
