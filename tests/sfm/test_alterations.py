"""Labelled cases: what a camera did to its images, by what is stated of it and what the pixels show."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from calibrary.calib.lens_models import Solvable
from calibrary.distortion import BrownConrady, Distortion, NoDistortion
from calibrary.records import replace
from calibrary.sfm.adjust import adjust
from calibrary.sfm.alterations import Claim, Kind, MeasuredCamera, claimed_shift, find_alterations
from calibrary.sfm.assessment import flight_result
from tests.sfm.flights import CAMERA, PLANS, fly

K = CAMERA.intrinsics
W, H = K.image_size
LENS = BrownConrady(k1=-0.08, k2=0.05, p1=0.0, p2=0.0, k3=-0.012)
WEAK = BrownConrady(k1=-0.004, k2=0.0, p1=0.0, p2=0.0, k3=0.0)
BROWN_PX = claimed_shift(Claim(K=replace(CAMERA, distortion=LENS))) or 0.0
"""What the lens does at the corners."""
LARGER: dict[str, Any] = {"native_size": (W * 5 // 4, H * 5 // 4)}


class Case(NamedTuple):
    """What is stated (lens, DigitalZoomRatio, the sensor's size), what the pixels show, and what follows."""

    what: str
    lens: Distortion | None
    seen: dict[str, Any]
    kinds: tuple[Kind, ...] = ()
    stated: dict[str, Any] = {}  # noqa: RUF012  read only


REMOVED, PRESENT, ZOOMED, CROPPED = Kind
CASES = (
    Case("as stated", LENS, {"corner": BROWN_PX}),
    Case("dewarped in the camera", LENS, {"corner": 0.4}, (REMOVED,)),
    Case("dewarped, not sure", LENS, {"corner": 0.4, "corner_std": 10.0}),
    Case("half of it: another lens, not a dewarped one", LENS, {"corner": BROWN_PX / 2}),
    Case("a lens that hardly distorts, and none is seen", WEAK, {"corner": 0.0}),
    Case("stated as dewarped, and it is", NoDistortion(), {"corner": 0.9}),
    Case("stated as dewarped, and it is not", NoDistortion(), {"corner": BROWN_PX}, (PRESENT,)),
    Case("stated as dewarped, not sure", NoDistortion(), {"corner": BROWN_PX, "corner_std": 10.0}),
    Case("nothing stated", None, {"corner": BROWN_PX}),
    Case("a fisheye by the catalogue that shows none", None, {"corner": 1.0}, (REMOVED,), {"fisheye": True}),
    Case("zoom that K is without", LENS, {"corner": BROWN_PX, "focal": 1.5}, (ZOOMED,), {"zoom": 1.5}),
    Case("zoom that K has, the pixels not", LENS, {"corner": BROWN_PX, "focal": 1 / 1.5}, (ZOOMED,), {"zoom": 1.5}),
    Case("zoom that K has", LENS, {"corner": BROWN_PX}, (), {"zoom": 1.5}),
    Case("a focal length that no tag explains", LENS, {"corner": BROWN_PX, "focal": 1.3}, (), {"zoom": 1.5}),
    Case("zoom within what is not certain", LENS, {"corner": BROWN_PX, "focal": 1.1, "std": 0.05}, (), {"zoom": 1.1}),
    Case("a crop taken for a smaller image", LENS, {"corner": BROWN_PX, "focal": 1.25}, (CROPPED,), LARGER),
    Case("a smaller image taken for a crop", LENS, {"corner": BROWN_PX, "focal": 0.8}, (CROPPED,), LARGER),
    Case("the whole frame", LENS, {"corner": BROWN_PX, "focal": 1.25}, (), {"native_size": (W, H)}),
    Case("a part that is not the middle", LENS, {"corner": BROWN_PX, "off": 0.08 * W}, (CROPPED,)),
    Case("a lens mounted off the middle", LENS, {"corner": BROWN_PX, "off": 0.015 * W}),
    Case("a principal point that is not determined", LENS, {"corner": BROWN_PX, "off": 0.08 * W, "off_std": 0.03 * W}),
)  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=[case.what for case in CASES])
def test_only_what_exceeds_its_sigma_is_stated(case: Case) -> None:
    claim = Claim(K=replace(CAMERA, distortion=case.lens), **case.stated)
    seen = {"corner_std": 0.5, "focal": 1.0, "std": 0.003, "off": 0.0, "off_std": 2.0} | case.seen
    found = [
        *find_alterations(
            claim,
            MeasuredCamera(
                focal_px=K.fx * seen["focal"],
                std=seen["std"],
                corner_px=(seen["corner"], seen["corner_std"]),
                centre_px=((K.cx + seen["off"], K.cy), (seen["off_std"], seen["off_std"])),
            ),
        )
    ]
    assert tuple(one.kind for one in found) == case.kinds
    assert all(" ± " in one.message for one in found)


def test_the_statement_is_in_px_at_the_corner_with_its_sigma() -> None:
    claim = Claim(K=replace(CAMERA, distortion=LENS))
    stated = claimed_shift(claim)
    assert stated is not None
    corner = np.array([[W - K.cx, H - K.cy]]) / K.fx
    radius = math.hypot(W, H) / 2 / K.fx
    along = np.array([[radius, 0.0]])
    assert stated == pytest.approx(float(LENS.distort(along)[0, 0] - radius) * K.fx, abs=0.5)
    assert math.hypot(*corner[0]) == pytest.approx(radius, rel=0.02)
    seen = MeasuredCamera(
        focal_px=K.fx, std=0.003, corner_px=(0.4, 0.7), centre_px=((K.cx, K.cy), (2.0, 2.0))
    )
    [one] = find_alterations(claim, seen)
    assert f"{stated:+.1f} px at the corner of the image, and the pixels show +0.4 ± 0.7 px" in one.message


def test_a_flight_that_its_tags_describe_wrongly_is_noticed() -> None:
    """The whole way: a simulated flight with a lens, and tags that state none, twice the zoom, or the truth."""
    tracks, scene = fly(replace(PLANS["oblique, relief, no GPS"], rows=2, columns=3), 3)
    found = adjust(tracks, scene, model=Solvable.BROWN)
    rules = {}
    for what, claim in {
        "nothing": None,
        "the truth": Claim(K=CAMERA),
        "no lens": Claim(K=replace(CAMERA, distortion=NoDistortion())),
        "zoom": Claim(
            K=replace(CAMERA, intrinsics=replace(K, fx=K.fx * 2, fy=K.fy * 2), distortion=None), zoom=2.0
        ),
    }.items():
        result = flight_result(found, claim=claim)
        rules[what] = set(result.rules) & set(Kind)
        assert all(one in {finding.rule for finding in result.findings} for one in rules[what])
    assert rules == {"nothing": set(), "the truth": set(), "no lens": {PRESENT}, "zoom": {ZOOMED}}
