"""The lens models a second time: a row each, with its formula as its source prints it, term by term.

Nothing is said about where a formula holds, and none of it shares code with the package.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from hypothesis import strategies as st

from calibrary.arrays import FloatArray
from calibrary.distortion import (
    MODELS,
    Australis,
    BrownConrady,
    Distortion,
    Division,
    DoubleSphere,
    ExtendedUnified,
    FieldOfView,
    Fisheye624,
    FisheyePolynomial,
    InverseBrown,
    InversePolynomial,
    KannalaBrandt,
    MetashapeFrame,
    NoDistortion,
    OffCentreBrown,
    RadialPolynomial,
    RadTanThinPrismFisheye,
    Rational,
    Scaramuzza,
    SplinedStereographic,
    ThinPrism,
    ThinPrismFisheye,
    Tilted,
    Unified,
)

Formula: TypeAlias = Callable[[SimpleNamespace, FloatArray], FloatArray]


def _columns(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.stack([x, y], axis=1)


def _plane(rays: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    x, y = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
    return x, y, x**2 + y**2


def _angle(rays: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """θ from the axis, and the unit vector across it."""
    X, Y, Z = rays.T
    across = np.sqrt(X**2 + Y**2)
    safe = np.where(across == 0, 1.0, across)
    return np.arctan2(across, Z), X / safe, Y / safe


def _powers(s: FloatArray, *coefficients: float) -> FloatArray:
    """The polynomial 1 + c1·s + c2·s² and so on."""
    return 1.0 + sum((c * s ** (i + 1) for i, c in enumerate(coefficients)), start=np.zeros_like(s))


def _none(_: SimpleNamespace, rays: FloatArray) -> FloatArray:
    x, y, _r2 = _plane(rays)
    return _columns(x, y)


def _brown(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    x, y, r2 = _plane(rays)
    radial = _powers(r2, c.k1, c.k2, c.k3)
    return _columns(
        x * radial + 2 * c.p1 * x * y + c.p2 * (r2 + 2 * x**2),
        y * radial + c.p1 * (r2 + 2 * y**2) + 2 * c.p2 * x * y,
    )


def _rational(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    x, y, r2 = _plane(rays)
    radial = _powers(r2, c.k1, c.k2, c.k3) / _powers(r2, c.k4, c.k5, c.k6)
    return _columns(
        x * radial + 2 * c.p1 * x * y + c.p2 * (r2 + 2 * x**2),
        y * radial + c.p1 * (r2 + 2 * y**2) + 2 * c.p2 * x * y,
    )


def _thin_prism(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    r2 = _plane(rays)[2]
    return _rational(c, rays) + _columns(c.s1 * r2 + c.s2 * r2**2, c.s3 * r2 + c.s4 * r2**2)


def _tilted(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    about_x = np.array(
        [[1, 0, 0], [0, math.cos(c.tau_x), math.sin(c.tau_x)], [0, -math.sin(c.tau_x), math.cos(c.tau_x)]]
    )
    about_y = np.array(
        [[math.cos(c.tau_y), 0, -math.sin(c.tau_y)], [0, 1, 0], [math.sin(c.tau_y), 0, math.cos(c.tau_y)]]
    )
    R = about_y @ about_x
    onto = np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]])
    upright = _thin_prism(c, rays)
    seen = np.column_stack([upright, np.ones(len(upright))]) @ (onto @ R).T
    return np.asarray(seen[:, :2] / seen[:, 2:])


def _metashape(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    x, y, r2 = _plane(rays)
    radial, growth = _powers(r2, c.k1, c.k2, c.k3, c.k4), _powers(r2, c.p3, c.p4)
    return _columns(
        x * radial + (c.p1 * (r2 + 2 * x**2) + 2 * c.p2 * x * y) * growth,
        y * radial + (c.p2 * (r2 + 2 * y**2) + 2 * c.p1 * x * y) * growth,
    )


def _about_centre(c: SimpleNamespace, xy: FloatArray) -> FloatArray:
    x, y = xy[:, 0] - c.x0, xy[:, 1] - c.y0
    r2 = x**2 + y**2
    radial = _powers(r2, c.k1, c.k2, c.k3, c.k4, c.k5)
    return _columns(
        c.x0 + x * radial + 2 * c.p1 * x * y + c.p2 * (r2 + 2 * x**2) + c.b1 * x + c.b2 * y,
        c.y0 + y * radial + c.p1 * (r2 + 2 * y**2) + 2 * c.p2 * x * y,
    )


def _off_centre(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    x, y, _r2 = _plane(rays)
    return _about_centre(c, _columns(x, y))


def _australis(c: SimpleNamespace, xy: FloatArray) -> FloatArray:
    """As Australis writes it: y up, P1 with x² and P2 with y²."""
    x, y = xy[:, 0], -xy[:, 1]
    r2 = x**2 + y**2
    P1, P2, B2 = c.p2, -c.p1, -c.b2
    radial = c.k1 * r2 + c.k2 * r2**2 + c.k3 * r2**3
    return _columns(
        x + x * radial + P1 * (r2 + 2 * x**2) + 2 * P2 * x * y + c.b1 * x + B2 * y,
        -(y + y * radial + P2 * (r2 + 2 * y**2) + 2 * P1 * x * y),
    )


def _growing(c: SimpleNamespace, xy: FloatArray) -> FloatArray:
    x, y = xy.T
    r2 = x**2 + y**2
    radial, growth = _powers(r2, c.k1, c.k2, c.k3, c.k4), _powers(r2, c.p3, c.p4)
    return _columns(
        x * radial + (2 * c.p1 * x * y + c.p2 * (r2 + 2 * x**2)) * growth + c.s1 * r2 + c.s2 * r2**2,
        y * radial + (c.p1 * (r2 + 2 * y**2) + 2 * c.p2 * x * y) * growth + c.s3 * r2 + c.s4 * r2**2,
    )


def _division(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    # Behind the camera the divisor is a difference of two equals: 64 bits of mantissa keep what is left of it.
    X, Y, Z = rays.T.astype(np.longdouble)
    divisor = Z + np.sqrt(Z**2 - 4 * c.k * (X**2 + Y**2))
    return _columns(2 * X / divisor, 2 * Y / divisor).astype(np.float64)


def _unified(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    X, Y, Z = rays.T
    depth = Z + c.xi * np.sqrt(X**2 + Y**2 + Z**2)
    c = SimpleNamespace(**vars(c), k3=0.0)
    return _brown(c, np.stack([X / depth, Y / depth, np.ones_like(X)], axis=1))


def _extended_unified(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    X, Y, Z = rays.T
    divisor = c.alpha * np.sqrt(c.beta * (X**2 + Y**2) + Z**2) + (1 - c.alpha) * Z
    return _columns(X / divisor, Y / divisor)


def _double_sphere(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    X, Y, Z = rays.T
    shifted = c.xi * np.sqrt(X**2 + Y**2 + Z**2) + Z
    divisor = c.alpha * np.sqrt(X**2 + Y**2 + shifted**2) + (1 - c.alpha) * shifted
    return _columns(X / divisor, Y / divisor)


def _field_of_view(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    x, y, r2 = _plane(rays)
    r = np.sqrt(r2)
    safe = np.where(r == 0, 1.0, r)
    # Its limit for no angle at all is the pinhole.
    seen = np.arctan(2 * r * math.tan(c.omega / 2)) / c.omega if abs(c.omega) > 1e-10 else r
    return _columns(x * seen / safe, y * seen / safe)


def _kannala_brandt(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    theta, u, v = _angle(rays)
    seen = theta * _powers(theta**2, c.k1, c.k2, c.k3, c.k4)
    return _columns(seen * u, seen * v)


def _fisheye_polynomial(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    """As Pix4D counts: t in right angles, focal length and polynomial scaled to match."""
    theta, u, v = _angle(rays)
    t, half_pi = 2 * theta / math.pi, math.pi / 2
    p2, p3, p4 = c.k2 * half_pi, c.k3 * half_pi**2, c.k4 * half_pi**3
    seen = (t + p2 * t**2 + p3 * t**3 + p4 * t**4) * half_pi
    return _columns(seen * u, seen * v)


def _fisheye624(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    theta, across, down = _angle(rays)
    u, v, r2 = theta * across, theta * down, theta**2
    radial = _powers(r2, c.k1, c.k2, c.k3, c.k4, c.k5, c.k6)
    return _columns(
        u * radial + 2 * c.p1 * u * v + c.p2 * (r2 + 2 * u**2) + c.s0 * r2 + c.s1 * r2**2,
        v * radial + 2 * c.p2 * u * v + c.p1 * (r2 + 2 * v**2) + c.s2 * r2 + c.s3 * r2**2,
    )


def _aria(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    theta, across, down = _angle(rays)
    seen = theta * _powers(theta**2, c.k0, c.k1, c.k2, c.k3, c.k4, c.k5)
    u, v, r2 = seen * across, seen * down, seen**2
    return _columns(
        u + c.p0 * (r2 + 2 * u**2) + 2 * c.p1 * u * v + c.s0 * r2 + c.s1 * r2**2,
        v + c.p1 * (r2 + 2 * v**2) + 2 * c.p0 * u * v + c.s2 * r2 + c.s3 * r2**2,
    )


def _thin_prism_fisheye(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    theta, across, down = _angle(rays)
    u, v, r2 = theta * across, theta * down, theta**2
    radial = _powers(r2, c.k1, c.k2, c.k3, c.k4)
    return _columns(
        u * radial + 2 * c.p1 * u * v + c.p2 * (r2 + 2 * u**2) + c.sx1 * r2,
        v * radial + 2 * c.p2 * u * v + c.p1 * (r2 + 2 * v**2) + c.sy1 * r2,
    )


def _cam2world(c: SimpleNamespace, xy: FloatArray) -> FloatArray:
    """OCamCalib's cam2world, as (x/z, y/z, 1) times depth: the ray of a distorted point."""
    s = np.hypot(*xy.T)
    return np.column_stack([xy, 1 + c.c2 * s**2 + c.c3 * s**3 + c.c4 * s**4])


def _radial_polynomial(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    x, y, r2 = _plane(rays)
    grown = _powers(np.sqrt(r2), c.k2, c.k3, c.k4)
    return _columns(x * grown, y * grown)


def _splined(c: SimpleNamespace, rays: FloatArray) -> FloatArray:
    X, Y, Z = rays.T
    length = np.sqrt(X**2 + Y**2 + Z**2)
    u, v = x, y = 2 * X / (length + Z), 2 * Y / (length + Z)
    per_unit = (c.nx - c.order) / (4 * math.tan(math.radians(c.fov_x_deg) / 4))

    def bumps(values: FloatArray, count: float) -> list[FloatArray]:
        at, n = values * per_unit + (count - 1) / 2, int(c.order)
        signs = [(-1) ** k * math.comb(n + 1, k) / math.factorial(n) for k in range(n + 2)]
        return [
            sum(
                (s * np.maximum(at - i + (n + 1) / 2 - k, 0) ** n for k, s in enumerate(signs)),
                start=np.zeros_like(at),
            )
            for i in range(int(count))
        ]

    for i, across in enumerate(bumps(x, c.nx)):
        for j, down in enumerate(bumps(y, c.ny)):
            u = u + across * down * vars(c)[f"x_{i}_{j}"]
            v = v + across * down * vars(c)[f"y_{i}_{j}"]
    return _columns(u, v)


class LensModel(NamedTuple):
    """What a model has to be.

    Attributes:
        names: its coefficients in the order of its source: what stands in files, entries and reports.
        lenses: from plausible to strong: some end inside a wide image, some see behind.
        projects: its formula, (N, 3) rays to (N, 2) distorted points.
        corrects: the formula of one that corrects the distorted point: (N, 2) points to (N, 2) undistorted ones, or to
            (N, 3) rays.
        optional: how many of the last coefficients may be left out, which means zero.
        at_zero: the image radius of a ray at an angle, with all coefficients zero: a pinhole's unless stated.
    """

    names: str
    lenses: st.SearchStrategy[Distortion]
    projects: Formula | None = None
    corrects: Formula | None = None
    optional: int = 0
    at_zero: Callable[[FloatArray], FloatArray] = np.tan


def _within(limit: float) -> st.SearchStrategy[float]:
    return st.floats(-limit, limit, allow_nan=False, width=64)


def terms(limit: float, *names: str) -> dict[str, st.SearchStrategy[float]]:
    """Coefficients up to a limit of either sign."""
    return dict.fromkeys(names, _within(limit))


_TANGENTIAL = terms(2e-3, "p1", "p2")
_RATIONAL = {**terms(0.2, "k1", "k2", "k3", "k4", "k5", "k6"), **_TANGENTIAL}
_PRISM = terms(2e-3, "s1", "s2", "s3", "s4")
_CENTRED = {**terms(0.3, "k1"), **terms(0.15, "k2", "k3", "k4", "k5"), **terms(5e-3, "p1", "p2")}
_OFF_CENTRE = {**_CENTRED, **terms(0.02, "b1", "b2"), **terms(0.05, "x0", "y0")}
_FISHEYE = {**terms(0.05, "k1", "k2"), **terms(0.01, "k3", "k4")}
_FISHEYE_PRISM = terms(4e-3, "s0", "s1", "s2", "s3")


def splined_lens(order: int, nx: int, ny: int, fov: int, size: float, seed: int) -> SplinedStereographic:
    """Knots at random, as large as lets the map turn back here and there."""
    knots = np.random.default_rng(seed).normal(0, size * math.radians(fov) / nx, 2 * nx * ny)
    return SplinedStereographic(order=order, nx=nx, ny=ny, fov_x_deg=fov, knots=tuple(knots.tolist()))


LENS_MODELS: Mapping[str, LensModel] = {
    "none": LensModel(
        "",
        st.builds(NoDistortion),
        projects=_none,
    ),
    "brown": LensModel(
        "k1 k2 p1 p2 k3",
        st.builds(BrownConrady, **terms(0.3, "k1"), **terms(0.15, "k2"), **terms(0.075, "k3"), **_TANGENTIAL),
        projects=_brown,
        optional=1,
    ),
    "rational": LensModel(
        "k1 k2 p1 p2 k3 k4 k5 k6",
        st.builds(Rational, **_RATIONAL),
        projects=_rational,
    ),
    "thin-prism": LensModel(
        "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4",
        st.builds(ThinPrism, **_RATIONAL, **_PRISM),
        projects=_thin_prism,
    ),
    "tilted": LensModel(
        "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y",
        st.builds(Tilted, **_RATIONAL, **_PRISM, **terms(0.05, "tau_x", "tau_y")),
        projects=_tilted,
    ),
    "kannala-brandt": LensModel(
        "k1 k2 k3 k4",
        st.builds(
            KannalaBrandt, **terms(0.1, "k1"), **terms(0.05, "k2"), **terms(0.02, "k3"), **terms(5e-3, "k4")
        ),
        projects=_kannala_brandt,
        at_zero=np.positive,
    ),
    "metashape": LensModel(
        "k1 k2 k3 k4 p1 p2 p3 p4",
        st.builds(
            MetashapeFrame,
            **terms(0.3, "k1", "k2", "k3", "k4"),
            **terms(0.02, "p1", "p2"),
            **terms(0.5, "p3", "p4"),
        ),
        projects=_metashape,
        optional=5,
    ),
    "observed-brown": LensModel(
        "k1 k2 p1 p2 k3 k4 k5 b1 b2 x0 y0",
        st.builds(InverseBrown, **_OFF_CENTRE),
        corrects=_about_centre,
        optional=7,
    ),
    "off-centre-brown": LensModel(
        "k1 k2 p1 p2 k3 k4 k5 b1 b2 x0 y0",
        st.builds(OffCentreBrown, **_OFF_CENTRE),
        projects=_off_centre,
        optional=7,
    ),
    "unified": LensModel(
        "xi k1 k2 p1 p2",
        st.builds(Unified, xi=st.floats(-0.8, 2.5), **terms(0.2, "k1", "k2"), **terms(0.01, "p1", "p2")),
        projects=_unified,
        optional=4,
    ),
    "extended-unified": LensModel(
        "alpha beta",
        st.builds(ExtendedUnified, alpha=st.floats(0.0, 1.0), beta=st.floats(0.05, 3.0)),
        projects=_extended_unified,
    ),
    "double-sphere": LensModel(
        "xi alpha",
        st.builds(DoubleSphere, xi=st.floats(-0.9, 1.5), alpha=st.floats(0.0, 1.0)),
        projects=_double_sphere,
    ),
    "field-of-view": LensModel(
        "omega",
        st.builds(FieldOfView, omega=_within(2.5)),
        projects=_field_of_view,
    ),
    "fisheye-polynomial": LensModel(
        "k2 k3 k4",
        st.builds(FisheyePolynomial, **terms(0.1, "k2", "k3"), **terms(0.05, "k4")),
        projects=_fisheye_polynomial,
        optional=1,
        at_zero=np.positive,
    ),
    "radial-polynomial": LensModel(
        "k2 k3 k4",
        st.builds(RadialPolynomial, **terms(0.1, "k2", "k3"), **terms(0.05, "k4")),
        projects=_radial_polynomial,
        optional=1,
    ),
    "australis": LensModel(
        "k1 k2 k3 p1 p2 b1 b2",
        st.builds(
            Australis, **terms(0.2, "k1", "k2", "k3"), **terms(5e-3, "p1", "p2"), **terms(0.05, "b1", "b2")
        ),
        corrects=_australis,
    ),
    "observed-polynomial": LensModel(
        "k1 k2 k3 k4 p1 p2 p3 p4 s1 s2 s3 s4",
        st.builds(
            InversePolynomial,
            **terms(0.2, "k1", "k2", "k3", "k4"),
            **terms(5e-3, "p1", "p2", "s1", "s2", "s3", "s4"),
            **terms(0.4, "p3", "p4"),
        ),
        corrects=_growing,
    ),
    # Below that the formula is rounded off behind the camera, and no lens is there.
    "division": LensModel(
        "k",
        st.builds(Division, k=_within(0.5).filter(lambda k: not 0 < abs(k) < 1e-12)),
        projects=_division,
    ),
    "fisheye624": LensModel(
        "k1 k2 k3 k4 k5 k6 p1 p2 s0 s1 s2 s3",
        st.builds(Fisheye624, **_FISHEYE, **terms(4e-3, "k5", "k6", "p1", "p2"), **_FISHEYE_PRISM),
        projects=_fisheye624,
        optional=4,
        at_zero=np.positive,
    ),
    "rad-tan-thin-prism-fisheye": LensModel(
        "k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3",
        st.builds(
            RadTanThinPrismFisheye,
            **terms(0.02, "k0", "k1"),
            **terms(5e-3, "k2", "k3", "k4", "k5"),
            **terms(4e-3, "p0", "p1"),
            **_FISHEYE_PRISM,
        ),
        projects=_aria,
        at_zero=np.positive,
    ),
    "thin-prism-fisheye": LensModel(
        "k1 k2 p1 p2 k3 k4 sx1 sy1",
        st.builds(ThinPrismFisheye, **_FISHEYE, **terms(4e-3, "p1", "p2", "sx1", "sy1")),
        projects=_thin_prism_fisheye,
        at_zero=np.positive,
    ),
    "scaramuzza": LensModel(
        "c2 c3 c4",
        st.builds(Scaramuzza, c2=st.floats(-0.6, 0.3), c3=st.floats(-0.1, 0.1), c4=st.floats(-0.3, 0.05)),
        corrects=_cam2world,
    ),
    "splined-stereographic": LensModel(
        "order nx ny fov_x_deg knots",
        st.builds(
            splined_lens,
            st.sampled_from([2, 3]),
            st.integers(4, 9),
            st.integers(4, 9),
            st.integers(30, 240),
            st.floats(0, 0.15),
            st.integers(0, 2**32 - 1),
        ),
        projects=_splined,
        at_zero=lambda angle: 2 * np.tan(angle / 2),
    ),
}
"""Every model by its name in files."""


def evenly(model: str, value: float) -> dict[str, Any]:
    """The fields of a model with every coefficient alike: of a splined one each knot's."""
    if model != "splined-stereographic":
        return dict.fromkeys(LENS_MODELS[model].names.split(), value)
    example = dict(MODELS[model].example)
    return example | {"knots": (value,) * len(example["knots"])}
