"""What every distortion model promises, whatever its formula: one specification, run over all of them."""

from __future__ import annotations

import inspect
import json
import math
import pickle
import re
from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules
from types import SimpleNamespace

import cv2
import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrary import distortion, schemas
from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, Intrinsics
from calibrary.distortion import MODELS, Distortion
from calibrary.errors import InputError
from tests.core.lens_models import LENS_MODELS, evenly
from tests.house.project import ROOT
from tests.strategies import DISTORTIONS, calibration
from tests.thorough import examples

QUICK = settings(max_examples=examples(4, 160))
EVERY_MODEL = pytest.mark.parametrize("model", LENS_MODELS)

ROUND = sorted(set(LENS_MODELS) - {"splined-stereographic"})
"""Models whose valid field is a disc; the splined one's is a polygon about it."""

PARTS = {"brown-polynomial", "planar-polynomial"}
"""Maps that some models are made of; no file names them."""


def coefficients(lens: Distortion) -> SimpleNamespace:
    return SimpleNamespace(**lens.coefficients)


def reach(lens: Distortion) -> float:
    """How far from the axis to look, radians: short of 90° and of straight back, where no float64 holds tan θ."""
    return min(lens.max_angle_rad(), 2.8 if lens.valid_radius() == math.inf and sees_behind(lens) else 1.3)


def sees_behind(lens: Distortion) -> bool:
    return lens.max_angle_rad() > math.pi / 2


def cone(widest_rad: float, *, narrowest_rad: float = 0.0) -> FloatArray:
    """(527, 3) directions of many lengths, all around the axis, up to an angle from it."""
    angle, around = np.meshgrid(np.linspace(narrowest_rad, widest_rad, 31), np.linspace(0, 2 * np.pi, 17))
    length = 0.1 + np.arange(angle.size) % 7
    unit = np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)
    return np.stack([part.ravel() * length for part in unit], axis=1)


def unit(directions: FloatArray) -> FloatArray:
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def in_front(rays: FloatArray, lens: Distortion) -> FloatArray:
    """(N, 2) undistorted points well inside the model's valid radius."""
    xy = rays[rays[:, 2] > 0.05]
    xy = xy[:, :2] / xy[:, 2:]
    return np.asarray(xy[np.hypot(*xy.T) < 0.95 * lens.valid_radius()])


def written_models() -> Iterator[type[Distortion]]:
    """Every class of the package with a model's name."""
    for module in iter_modules(distortion.__path__, f"{distortion.__name__}."):
        for kind in vars(import_module(module.name)).values():
            is_here = isinstance(kind, type) and kind.__module__ == module.name
            if is_here and issubclass(kind, Distortion) and vars(kind).get("model", "") not in {"", *PARTS}:
                yield kind


def missing_parts(kind: type[Distortion]) -> Iterator[str]:
    """What a model lacks, and where it belongs: the steps are in the docstring of ``calibrary.distortion``."""
    home, said = f"distortion/{kind.__module__.rpartition('.')[2]}.py", inspect.getdoc(kind) or ""
    if MODELS.get(kind.model) is not kind:
        yield f"a row in MODELS of distortion/__init__.py, or another name than {kind.model!r}"
    if kind.__name__ not in distortion.__all__:
        yield "its class in __all__ of distortion/__init__.py"
    if kind.names():
        if "::\n\n    " not in said or not re.search(r"^Sources?:", said, re.MULTILINE):
            yield f"its formula after '::' and its 'Source:' in its docstring, {home}"
        if not kind.example:
            yield f"example, a lens to draw, in {home}"
    if kind.model not in LENS_MODELS:
        yield "a row in tests/core/lens_models.py"
    if not (ROOT / f"docs/lenses/{kind.model}.svg").is_file():
        yield f"docs/lenses/{kind.model}.svg: run make pictures"
    if f"## {kind.model}\n" not in (ROOT / "docs/distortion.md").read_text():
        yield "a section in docs/distortion.md: run make docs"
    if f'"const": "{kind.model}"' not in (ROOT / "schemas/calibration-1.schema.json").read_text():
        yield "a place in schemas/calibration-1.schema.json: run make schemas"


def test_no_model_lacks_a_part() -> None:
    lacking = [f"{kind.model} lacks {part}" for kind in written_models() for part in missing_parts(kind)]
    assert not lacking, "\n".join(lacking)
    assert [row for row in LENS_MODELS if row not in MODELS] == []
    assert [
        name for name, row in LENS_MODELS.items() if (row.projects is None) == (row.corrects is None)
    ] == []


@EVERY_MODEL
def test_its_coefficients_have_their_sources_names_and_order(model: str) -> None:
    assert MODELS[model].model == model
    assert MODELS[model].names() == tuple(LENS_MODELS[model].names.split())


@EVERY_MODEL
@QUICK
@given(data=st.data())
def test_it_is_its_formula_inside_its_valid_field(model: str, data: st.DataObject) -> None:
    lens = data.draw(DISTORTIONS[model])
    rays = cone(0.98 * reach(lens))
    seen = lens.distort_rays(rays)
    assert np.isfinite(seen).all()
    projects, corrects = LENS_MODELS[model].projects, LENS_MODELS[model].corrects
    if projects is not None:
        np.testing.assert_allclose(seen, projects(coefficients(lens), rays), rtol=1e-10, atol=1e-13)
    if corrects is None:
        return
    corrected = corrects(coefficients(lens), seen)
    if corrected.shape[1] == 2:
        corrected = np.column_stack([corrected, np.ones(len(corrected))])
    np.testing.assert_allclose(unit(corrected), unit(rays), rtol=0, atol=1e-11)


@EVERY_MODEL
@QUICK
@given(data=st.data())
def test_every_ray_comes_back_from_where_it_is_seen(model: str, data: st.DataObject) -> None:
    lens = data.draw(DISTORTIONS[model])
    rays = cone(0.95 * reach(lens))
    back = lens.undistort_to_rays(lens.distort_rays(rays))
    np.testing.assert_allclose(back, unit(rays), rtol=0, atol=1e-11)


@EVERY_MODEL
@QUICK
@given(data=st.data())
def test_the_plane_and_the_rays_say_the_same(model: str, data: st.DataObject) -> None:
    lens = data.draw(DISTORTIONS[model])
    undistorted = in_front(cone(0.95 * reach(lens)), lens)
    distorted = lens.distort(undistorted)
    rays = np.column_stack([undistorted, np.ones(len(undistorted))])
    np.testing.assert_allclose(distorted, lens.distort_rays(rays), rtol=1e-12, atol=1e-15)
    back = lens.undistort(distorted)
    assert (np.hypot(*(back - undistorted).T) <= 1e-9 * (1 + np.hypot(*undistorted.T) ** 2)).all()


@EVERY_MODEL
@QUICK
@given(data=st.data())
def test_it_is_one_to_one_up_to_its_widest_angle(model: str, data: st.DataObject) -> None:
    lens = data.draw(DISTORTIONS[model])
    angle, around = np.meshgrid(np.linspace(1e-3, 1 - 1e-4, 100) * reach(lens), np.linspace(0, 2 * np.pi, 17))

    def seen(angle: FloatArray, around: FloatArray) -> FloatArray:
        rays = np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)
        return lens.distort_rays(np.stack([part.ravel() for part in rays], axis=1))

    h = 1e-6
    outward = seen(angle * (1 + h), around) - seen(angle * (1 - h), around)
    onward = seen(angle, around + h) - seen(angle, around - h)
    # The Jacobian determinant: the turn from outward to onward never changes its sense.
    turn = outward[:, 0] * onward[:, 1] - outward[:, 1] * onward[:, 0]
    assert (turn > -1e-7 * np.hypot(*outward.T) * np.hypot(*onward.T)).all()


@pytest.mark.parametrize("model", ROUND)
@QUICK
@given(data=st.data())
def test_from_its_widest_angle_on_nothing_is_seen(model: str, data: st.DataObject) -> None:
    lens = data.draw(DISTORTIONS[model])
    widest, radius = lens.max_angle_rad(), lens.valid_radius()
    assert 0 < widest <= math.pi
    if widest < 1.57:
        assert radius == pytest.approx(math.tan(widest))
    else:
        assert radius > 1e3
    if widest < 0.999 * math.pi:
        beyond = cone(math.pi, narrowest_rad=widest * (1 + 1e-9))
        assert np.isnan(lens.distort_rays(beyond)).all()
    if radius < 1e6:
        circle = radius * np.column_stack([np.cos(np.arange(64)), np.sin(np.arange(64))])
        assert np.isnan(lens.distort(circle * np.geomspace(1 + 1e-9, 100, 64)[:, None])).all()
        assert np.isfinite(lens.distort(0.999 * circle)).all()


@pytest.mark.parametrize("model", ROUND)
@QUICK
@given(data=st.data())
def test_no_answer_lies_outside_its_valid_field(model: str, data: st.DataObject) -> None:
    lens = data.draw(DISTORTIONS[model])
    turn = np.linspace(0, 2 * math.pi, 60)
    distorted = np.geomspace(1e-3, 1e3, 60)[:, None, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    undistorted = lens.undistort(distorted.reshape(-1, 2))
    assert not (np.hypot(*undistorted.T) >= lens.valid_radius()).any()
    depth = lens.undistort_to_rays(distorted.reshape(-1, 2))[:, 2]
    assert not (depth < math.cos(lens.max_angle_rad()) - 1e-12).any()


@pytest.mark.parametrize("model", sorted({*ROUND} - {"observed-brown", "off-centre-brown"}))
@QUICK
@given(data=st.data())
def test_the_axis_is_not_moved_but_by_a_centre_of_its_own(model: str, data: st.DataObject) -> None:
    lens, axis = data.draw(DISTORTIONS[model]), np.zeros((1, 2))
    assert np.abs(lens.distort(axis)).max() <= 1e-16
    assert np.abs(lens.undistort(axis)).max() <= 1e-16


@EVERY_MODEL
def test_zero_coefficients_move_nothing(model: str) -> None:
    lens = MODELS[model](**evenly(model, 0.0) | ({"beta": 1.0} if model == "extended-unified" else {}))
    rays = cone(1.2)
    angle = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    size = LENS_MODELS[model].at_zero(angle)
    across = rays[:, :2] / np.maximum(np.hypot(rays[:, 0], rays[:, 1]), 1e-300)[:, None]
    np.testing.assert_allclose(lens.distort_rays(rays), across * size[:, None], rtol=1e-13, atol=1e-15)
    if model not in ROUND:
        return
    # Scaramuzza's model is looked at up to a radius of a million.
    assert lens.valid_radius() >= 1e6
    assert lens.max_angle_rad() == pytest.approx(
        math.pi / 2 if LENS_MODELS[model].at_zero is np.tan else math.pi
    )


@EVERY_MODEL
@QUICK
@given(data=st.data())
def test_the_rows_of_an_array_do_not_know_of_one_another(model: str, data: st.DataObject) -> None:
    lens = data.draw(DISTORTIONS[model])
    rays = cone(0.95 * reach(lens))
    points = lens.distort_rays(rays)
    some = [0, 5, 317, 526]
    one_by_one = np.concatenate([lens.undistort_to_rays(points[i : i + 1]) for i in some])
    np.testing.assert_allclose(lens.undistort_to_rays(points)[some], one_by_one, rtol=1e-12, atol=1e-14)
    one_by_one = np.concatenate([lens.distort_rays(rays[i : i + 1]) for i in some])
    np.testing.assert_allclose(points[some], one_by_one, rtol=1e-12, atol=1e-14)


@EVERY_MODEL
def test_more_rows_than_a_block_are_all_answered(model: str) -> None:
    lens = MODELS[model](**evenly(model, 1e-3))
    rays = np.tile(cone(0.6), (32, 1))
    seen = lens.distort_rays(rays)
    np.testing.assert_allclose(seen, np.tile(seen[:527], (32, 1)), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(lens.undistort_to_rays(seen), unit(rays), rtol=0, atol=1e-11)


@EVERY_MODEL
@QUICK
@given(data=st.data())
def test_what_is_not_a_number_gives_none(model: str, data: st.DataObject) -> None:
    lens = data.draw(DISTORTIONS[model])
    bad = np.array([[math.nan, 0.1], [0.1, math.nan], [math.inf, 0.1], [-0.1, -math.inf]])
    rays = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [math.nan, 0.0, 1.0], [0.1, 0.0, math.nan]])
    kept = bad.copy(), rays.copy()
    assert np.isnan(lens.distort(bad)).all()
    assert np.isnan(lens.undistort(bad)).all()
    assert np.isnan(lens.undistort_to_rays(bad)).all()
    assert np.isnan(lens.distort_rays(rays)).all()
    assert np.array_equal(bad, kept[0], equal_nan=True)
    assert np.array_equal(rays, kept[1], equal_nan=True)
    assert lens.distort(np.empty((0, 2))).shape == lens.undistort(np.empty((0, 2))).shape == (0, 2)
    assert lens.distort_rays(np.empty((0, 3))).shape == (0, 2)
    assert lens.undistort_to_rays(np.empty((0, 2))).shape == (0, 3)


@EVERY_MODEL
@QUICK
@given(data=st.data())
def test_it_survives_pickling_and_json(model: str, data: st.DataObject) -> None:
    lens = data.draw(DISTORTIONS[model])
    again = pickle.loads(pickle.dumps(lens))  # noqa: S301 - our own bytes
    assert again == lens
    assert hash(again) == hash(lens)
    camera = calibration(Intrinsics(fx=900, fy=899, cx=500, cy=400, image_size=(1000, 800)), lens)
    document = camera.to_dict()
    schemas.require(document, "calibration-1")
    document = json.loads(json.dumps(document))
    assert Calibration.from_dict(document) == camera
    written = document["distortion"]
    assert list(written) == ["model", *LENS_MODELS[model].names.split()]
    assert written.pop("model") == model
    assert MODELS[model](**written) == lens


@EVERY_MODEL
def test_only_its_optional_coefficients_may_be_left_out(model: str) -> None:
    names, make = LENS_MODELS[model].names.split(), MODELS[model]
    every = evenly(model, 0.01)
    optional = names[len(names) - LENS_MODELS[model].optional :]
    for name in names:
        some = {other: value for other, value in every.items() if other != name}
        if name in optional:
            assert make(**some) == make(**{**every, name: 0.0})
            continue
        with pytest.raises(TypeError, match=name):
            make(**some)


@EVERY_MODEL
def test_a_coefficient_that_is_not_a_finite_number_is_refused(model: str) -> None:
    every: dict[str, object] = evenly(model, 0.01)
    for value in (math.nan, math.inf, -math.inf, "0.1", None, True, 10**400, 1j, [0.1]):
        for name in every:
            with pytest.raises(InputError, match=f"{name} of the {model} model is") as caught:
                MODELS[model](**{**every, name: value})
            assert caught.value.place == name


# ── peers ────────────────────────────────────────────────────────────────────────────────────────────────────

F, CENTRE, SIZE = (1650.1, 1648.7), (2741.3, 1815.9), (5472, 3648)

OPENCV = {"none", "brown", "rational", "thin-prism", "tilted", "kannala-brandt"}

COLMAP = {
    "PINHOLE": ("none", ""),
    "OPENCV": ("brown", "k1 k2 p1 p2"),
    "FULL_OPENCV": ("rational", "k1 k2 p1 p2 k3 k4 k5 k6"),
    "OPENCV_FISHEYE": ("kannala-brandt", "k1 k2 k3 k4"),
    "FISHEYE": ("kannala-brandt", ""),
    "FOV": ("field-of-view", "omega"),
    "THIN_PRISM_FISHEYE": ("thin-prism-fisheye", "k1 k2 p1 p2 k3 k4 sx1 sy1"),
    "RAD_TAN_THIN_PRISM_FISHEYE": ("rad-tan-thin-prism-fisheye", "k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3"),
    "DIVISION": ("division", "k"),
    "EUCM": ("extended-unified", "alpha beta"),
}
"""COLMAP's camera models of two focal lengths: ours, and their parameters after fx, fy, cx, cy in ours' names."""

ONE_FOCAL_LENGTH = {
    "SIMPLE_PINHOLE": ("none", ""),
    "SIMPLE_RADIAL": ("brown", "k1"),
    "RADIAL": ("brown", "k1 k2"),
    "SIMPLE_FISHEYE": ("kannala-brandt", ""),
    "SIMPLE_RADIAL_FISHEYE": ("kannala-brandt", "k1"),
    "RADIAL_FISHEYE": ("kannala-brandt", "k1 k2"),
    "SIMPLE_DIVISION": ("division", "k"),
}
"""Those of one: f, cx, cy and these."""

NO_COUNTERPART = {"INVALID", "EQUIRECTANGULAR"}


def near(lens: Distortion) -> FloatArray:
    """Rays in front of the camera, inside the valid field."""
    return cone(0.9 * min(lens.max_angle_rad(), 1.2))


def pixels(lens: Distortion, rays: FloatArray, focal: tuple[float, float] = F) -> FloatArray:
    intrinsics = Intrinsics(fx=focal[0], fy=focal[1], cx=CENTRE[0], cy=CENTRE[1], image_size=SIZE)
    return calibration(intrinsics, lens).project(rays)


@pytest.mark.parametrize("model", sorted(OPENCV))
@QUICK
@given(data=st.data())
def test_it_projects_as_opencv_does(model: str, data: st.DataObject) -> None:
    lens = data.draw(DISTORTIONS[model])
    rays = near(lens)
    matrix = np.array([[F[0], 0, CENTRE[0] - 0.5], [0, F[1], CENTRE[1] - 0.5], [0, 0, 1]])
    D = np.array(list(lens.coefficients.values()) or [0.0] * 4)
    project = cv2.fisheye.projectPoints if model == "kannala-brandt" else cv2.projectPoints
    theirs = project(np.ascontiguousarray(rays[:, None]), np.zeros(3), np.zeros(3), matrix, D)[0]
    ours = pixels(lens, rays)
    np.testing.assert_allclose(ours, np.asarray(theirs).reshape(-1, 2) + 0.5, rtol=1e-12, atol=1e-9)


def test_every_camera_model_of_colmap_has_its_counterpart() -> None:
    assert set(pycolmap.CameraModelId.__members__) - NO_COUNTERPART <= {*COLMAP, *ONE_FOCAL_LENGTH}


@pytest.mark.parametrize("name", [*COLMAP, *ONE_FOCAL_LENGTH])
@QUICK
@given(data=st.data())
def test_it_projects_as_colmap_does(name: str, data: st.DataObject) -> None:
    if name not in pycolmap.CameraModelId.__members__:
        pytest.skip(f"this COLMAP has no {name}")
    model, kept = (COLMAP | ONE_FOCAL_LENGTH)[name]
    drawn = data.draw(DISTORTIONS[model])
    names = LENS_MODELS[model].names.split()
    lens = MODELS[model](**{n: getattr(drawn, n) if n in kept.split() else 0.0 for n in names})
    # COLMAP replaces the formula of small angles by a series that misses it, see FieldOfView.
    if model == "field-of-view" and abs(lens.coefficients["omega"]) < 0.02:
        return
    focal = F if name in COLMAP else (F[0], F[0])
    theirs = pycolmap.Camera.create_from_model_name(1, name, F[0], *SIZE)
    theirs.params = [
        *(focal if name in COLMAP else F[:1]),
        *CENTRE,
        *(lens.coefficients[n] for n in kept.split()),
    ]
    rays = near(lens)
    np.testing.assert_allclose(
        pixels(lens, rays, focal), np.asarray(theirs.img_from_cam(rays)), rtol=1e-12, atol=1e-9
    )
