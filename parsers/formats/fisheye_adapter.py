"""Fisheye-Calib-Adapter's camera models in YAML, between which the tool converts.

In the format's own words::

    image: {width: 752, height: 480}
    parameter:
      fx: 348.11
      fy: 347.11
      cx: 365.81
      cy: 249.36
      alpha: 0.5657        # UCM: alpha; EUCM: alpha, beta; DS: alpha, xi; KB: k1 … k4
      xi: -0.2443

The model is the file's name (``DS.yml``), and the names of the parameters tell it as well. UCM's alpha is EUCM's with
beta = 1. OCamCalib's model is read from the ray polynomial (``unprojection``), from the other one nothing is taken.

Sources: S. Lee, "Fisheye-Calib-Adapter", 2024, ``FCA``'s ``model/*.cpp`` (``parse``, ``project``); the models' own
papers.
"""

from __future__ import annotations

import math

from calibrary.calibration import Calibration
from calibrary.distortion import Distortion, DoubleSphere, ExtendedUnified, KannalaBrandt
from calibrary.errors import UnsupportedModelError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._one_camera import camera
from calibrary.parsers.formats._opencv_lens import lens
from calibrary.parsers.formats._taylor import taylor_lens, upper_triangle
from calibrary.records import replace

CONVENTION = Convention(origin=Origin.PIXEL_CENTRE, remarks=("the names of the parameters tell the model",))
PLACE = ("fx", "fy", "cx", "cy")
MODEL = Option(
    name="model", values=("ucm",), meaning="whether a file with alpha alone is of UCM, and not cut short"
)


def sniff(content: Content) -> Sniff | None:
    """The two tables, with a parameter of a model in it."""
    if content.yaml_keys[:2] == ("image", "parameter") and "  cx:" in (content.text or ""):
        return Sniff(Sure.MAGIC, "the keys image and parameter, with cx")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera."""
    tree = storage.load(data, source=context.name)
    node, size = tree["parameter"], tree["image"].image_size("width", "height")
    if "coefficients" in node:
        return [_ocam(node, context, size)]
    fx, fy, cx, cy = (node[key].number() for key in PLACE)
    native = Native(fx=fx, fy=fy, cx=cx, cy=cy)
    is_named = context.option(MODEL.name) is not None or "ucm" in context.name.lower()
    if "alpha" in node and not ({"xi", "beta"} & set(node.keys()) or is_named):
        node.fail(
            "alpha alone is UCM's, and also that of a file of DS or EUCM that was cut short; name the file UCM.yml "
            "or give --set model=ucm"
        )
    return [camera(context, CONVENTION, native, size, _lens(node), tag="parameter")]


def _lens(node: Node) -> Distortion:
    own = {key: value.number() for key, value in node.entries() if key not in PLACE}
    names = set(own)
    if names == {"alpha", "xi"}:
        return DoubleSphere(xi=own["xi"], alpha=own["alpha"])
    if names in ({"alpha"}, {"alpha", "beta"}):
        if not 0 <= own["alpha"] <= 1:
            raise UnsupportedModelError(
                f"alpha is {own['alpha']:g}, expected 0 to 1: beyond, the model is another one, which is not known "
                "here; fit the camera with DS or KB in the tool",
                place="parameter.alpha",
            )
        return ExtendedUnified(alpha=own["alpha"], beta=own.get("beta", 1.0))
    if names == set(KannalaBrandt.names()):
        return KannalaBrandt(**own)
    if names <= {"k1", "k2", "k3", "p1", "p2"} and {"k1", "k2", "p1", "p2"} <= names:
        return lens([own.get(name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3")])
    raise UnsupportedModelError(
        f"the parameters are {', '.join(sorted(own)) or 'none'}, of no model that is known here; expected UCM, EUCM, "
        "DS, KB, RadTan or OCamCalib",
        place="parameter",
    )


def _ocam(node: Node, context: ReadContext, size: tuple[int, int]) -> Calibration:
    terms = node["coefficients"]["unprojection"]
    made, f = taylor_lens(terms.numbers(), place=terms.place or "unprojection")
    c, d, e = (node[key].number() for key in ("c", "d", "e"))
    fx, skew, fy, turn = upper_triangle(
        f * c, 1 / c if c else 0.0, e / c if c else 0.0, d / c if c else 0.0, place="c"
    )
    native = Native(fx=fx, fy=fy, cx=node["cx"].number(), cy=node["cy"].number(), skew=skew)
    item = camera(context, CONVENTION, native, size, made, tag="parameter")
    note = f"the camera's frame is turned about its axis by {math.degrees(turn):.4f}° against the file's"
    return replace(item, notes=(*item.notes, note)) if turn else item


FORMAT = Format(
    name="fisheye_adapter",
    title="Fisheye-Calib-Adapter camera",
    suffixes=(".yml", ".yaml"),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/eowjd0512/fisheye-calib-adapter",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    options=(MODEL,),
)
