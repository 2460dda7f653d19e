"""Each rule of the verdict at its limit: silent where the limit is kept, and as grave as its table says beyond."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from calibrary.calib.board_shape import BoardShape, Stretch
from calibrary.calib.budget import Part, budget_of
from calibrary.calib.geometry import Coverage, Geometry
from calibrary.calib.lens_models import Solvable
from calibrary.calib.misfit import Cause, Misfit, Rival
from calibrary.calib.model_choice import Candidate, WarpTest
from calibrary.calib.verdict import BOARD, LIMITS, Departure, Evidence
from calibrary.calib.verdict_rules import judge
from calibrary.quality import Proven
from calibrary.records import replace
from calibrary.validation import Severity

NOTE, UNPROVEN, ERROR = Severity.NOTE, Severity.UNPROVEN, Severity.ERROR

COVERAGE = Coverage(cells=((True,) * 8,) * 6, fraction=0.65, border=1.0, reach=0.5)
GEOMETRY = Geometry(
    tilt_spread_deg=20.0, roll_spread_deg=90.0, depth_ratio=1.2, distance=2000.0, coverage=COVERAGE
)
PROVEN = Proven(radius_px=2500.0, share=0.4, sigma_px=0.4, edge_px=0.5)
DEPARTURE = Departure(px=0.5, std_px=0.1, x=100.0, y=100.0, is_of_lens=True)
SOUND = Evidence(
    image_size=(5472, 3648),
    subject=BOARD,
    is_board=True,
    views=15,
    views_shown=15,
    repeats=0,
    views_out=0,
    corners_out=0,
    geometry=GEOMETRY,
    fx=1000.0,
    budget=budget_of(0.00099**2, 2.0, (), 15),
    kappa2=2.0,
    rms_px=0.25,
    noise_px=0.05,
    condition=1e8,
    model=Solvable.BROWN,
    culprits=(),
    sound=(1.0, 1.0),
    better=None,
    proven=PROVEN,
    departure=None,
    rival=None,
    near=0.7,
    warp=None,
    is_warped=False,
    shape=None,
    is_lifted=False,
    stretch=None,
    misfit=None,
    focus="manual",
)
"""A camera that keeps every limit, most of them exactly."""


def rules(**changed: Any) -> dict[str, Severity]:
    """What the changed evidence is told, with its gravity."""
    whole = dict(changed)
    seen = {name: whole.pop(name) for name in list(whole) if name in Coverage.__struct_fields__}
    lie = {name: whole.pop(name) for name in list(whole) if name in Geometry.__struct_fields__}
    geometry = replace(GEOMETRY, coverage=replace(COVERAGE, **seen), **lie)
    if (sigma := whole.pop("sigma", None)) is not None:
        whole["budget"] = budget_of(sigma**2, 2.0, (), 15)
    return {one.rule: one.severity for one in judge(replace(SOUND, geometry=geometry, **whole))}


def bent(p: float = 0.0) -> BoardShape:
    none = np.zeros(0)
    return BoardShape(f=9.0, p=p, lifts_mm=np.full((1, 1), 0.3), shift=none, covariance=np.zeros((0, 0)))


def fault(*causes: Cause, focal: float = 0.0) -> Misfit:
    rivals = [Rival(cause=one, left_px=0.1, criterion=-900.0, p=0.0, focal=focal) for one in causes]
    return Misfit(rivals=tuple(rivals), sigma_px=0.5, noise_px=0.1, scalars=3000)


WARP = WarpTest(f=99.0, dof=900, p=0.0, warp_mm=(0.3, -0.1))
BETTER = Candidate(
    model=Solvable.RATIONAL, rms_px=0.1, criterion=-90.0, condition=1e9, refused="it is not determined"
)


def test_evidence_that_keeps_every_limit_is_told_nothing() -> None:
    assert rules() == {}


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"views": 14}, {"few-views": NOTE}),
        ({"views": 10}, {"few-views": NOTE}),
        ({"views": 9}, {"few-views": UNPROVEN}),
        ({"views": 7, "is_board": False}, {}),
        ({"repeats": 1}, {"duplicates": NOTE}),
        ({"views": 17, "views_out": 3}, {"views-rejected": NOTE}),
        ({"views": 16, "views_out": 3}, {"views-rejected": UNPROVEN}),
        ({"corners_out": 1}, {"corners-rejected": NOTE}),
        ({"tilt_spread_deg": 5.0}, {"low-tilt": UNPROVEN}),
        ({"tilt_spread_deg": 4.9}, {"low-tilt": ERROR}),
        ({"tilt_spread_deg": math.nan}, {"low-tilt": ERROR}),
        ({"tilt_spread_deg": 0.0, "is_board": False}, {}),
        ({"near": 0.1}, {}),
        ({"near": 0.09}, {"centre-only": ERROR}),
        ({"proven": replace(PROVEN, share=0.39)}, {"unproven-region": UNPROVEN}),
        ({"proven": replace(PROVEN, share=0.0, sigma_px=None)}, {"unproven-region": UNPROVEN}),
        ({"sound": (0.99, 0.9)}, {"not-monotonic": ERROR}),
        ({"sound": (1.0, 0.9)}, {"valid-region": NOTE}),
        ({"proven": replace(PROVEN, edge_px=0.6)}, {"uncertain-edge": NOTE}),
        ({"proven": None}, {"unknown-uncertainty": UNPROVEN}),
        ({"sigma": 0.00101}, {"uncertain-focal-length": UNPROVEN}),
        ({"sigma": 0.0199}, {"uncertain-focal-length": UNPROVEN}),
        ({"sigma": 0.0201}, {"uncertain-focal-length": ERROR}),
        ({"condition": 1.1e8}, {"undetermined": ERROR}),
        ({"condition": 1.1e8, "model": Solvable.RATIONAL}, {}),
        # Three times the noise of a corner, 0.14 px in both coordinates; refused from ten times.
        ({"rms_px": 0.42, "noise_px": 0.1}, {}),
        ({"rms_px": 0.43, "noise_px": 0.1}, {"poor-fit": UNPROVEN}),
        ({"rms_px": 1.42, "noise_px": 0.1}, {"poor-fit": ERROR}),
        # No residual below a quarter of the limit in px, here 0.25 px, is a misfit.
        ({"rms_px": 0.25, "noise_px": 0.05}, {}),
        ({"rms_px": 0.26, "noise_px": 0.05}, {"poor-fit": UNPROVEN}),
        ({"rms_px": 0.8, "noise_px": 0.05}, {"poor-fit": ERROR}),
        ({"rms_px": 1.0, "noise_px": None}, {}),
        ({"rms_px": 1.1, "noise_px": None}, {"poor-fit": UNPROVEN}),
        ({"rms_px": 3.1, "noise_px": None}, {"poor-fit": ERROR}),
        ({"rms_px": 0.5, "noise_px": None, "image_size": (1920, 1440)}, {}),
        ({"rms_px": 0.6, "noise_px": None, "image_size": (1920, 1440)}, {"poor-fit": UNPROVEN}),
        ({"better": BETTER}, {"lens-model": UNPROVEN}),
        ({"kappa2": None}, {"no-variance-factor": UNPROVEN}),
        # Up to 14 what the views disagree about is in σ × κ.
        ({"kappa2": 2.1}, {"unstable": NOTE}),
        ({"kappa2": 14.1}, {"unstable": UNPROVEN}),
        ({"departure": DEPARTURE}, {"lens-departs": NOTE}),
        ({"departure": DEPARTURE, "kappa2": 14.1}, {"lens-departs": NOTE, "unstable": NOTE}),
        ({"departure": replace(DEPARTURE, px=0.51)}, {"lens-departs": UNPROVEN}),
        ({"departure": replace(DEPARTURE, px=0.51, is_of_lens=False)}, {}),
        ({"warp": WARP}, {"board-warp": UNPROVEN}),
        ({"warp": WARP, "is_warped": True}, {"board-warp": NOTE}),
        ({"warp": replace(WARP, p=0.01)}, {}),
        ({"shape": bent()}, {"board-shape": UNPROVEN}),
        ({"shape": bent(), "is_lifted": True}, {"board-shape": NOTE}),
        ({"shape": bent(p=0.5)}, {}),
        ({"stretch": Stretch(value=-3e-4, std=5e-5)}, {"stretched-print": UNPROVEN}),
        ({"stretch": Stretch(value=3e-4, std=6e-5)}, {}),
        ({"stretch": Stretch(value=2e-4, std=1e-5)}, {}),
        ({"distance": 50.0}, {}),
        ({"distance": 49.0}, {"wrong-square": UNPROVEN}),
        ({"distance": 1.1e5}, {"wrong-square": UNPROVEN}),
        ({"distance": 1.1e5, "unit": "squares"}, {}),
        ({"distance": 1.1e5, "is_board": False}, {}),
        ({"misfit": fault(Cause.ROLLING_SHUTTER)}, {"rolling-shutter": NOTE}),
        ({"misfit": fault(Cause.TWO_CAMERAS)}, {"two-cameras": NOTE}),
        # A fault that views contradict one another by harms if it moves the focal length by more than σ.
        (
            {"misfit": fault(Cause.FOCUS_CHANGES, focal=0.0009), "kappa2": 2.1},
            {"focus-changes": NOTE, "unstable": NOTE},
        ),
        (
            {"misfit": fault(Cause.FOCUS_CHANGES, focal=-0.0011), "kappa2": 2.1},
            {"focus-changes": UNPROVEN, "unstable": NOTE},
        ),
        ({"misfit": fault(Cause.FOCUS_CHANGES, focal=0.0011)}, {"focus-changes": NOTE}),
        ({"misfit": fault(Cause.TWO_CAMERAS), "kappa2": 2.1}, {"two-cameras": ERROR, "unstable": NOTE}),
        (
            {"misfit": fault(Cause.TWO_CAMERAS), "kappa2": None},
            {"two-cameras": ERROR, "no-variance-factor": UNPROVEN},
        ),
        (
            {"misfit": fault(Cause.STABILISED), "kappa2": None},
            {"stabilised": UNPROVEN, "no-variance-factor": UNPROVEN},
        ),
        (
            {"misfit": fault(Cause.TWO_CAMERAS, Cause.STABILISED), "kappa2": None},
            {"unclear-cause": UNPROVEN, "no-variance-factor": UNPROVEN},
        ),
        ({"misfit": fault(Cause.STRETCHED_PRINT)}, {}),
        ({"misfit": fault()}, {}),
        ({"focus": None}, {"focus-unknown": NOTE}),
        ({"focus": "Autofocus"}, {"focus-not-locked": UNPROVEN}),
    ],
)
def test_beyond_a_limit_its_rule_is_told_and_no_other(
    changed: dict[str, Any], expected: dict[str, Severity]
) -> None:
    assert rules(**({"noise_px": 0.06} | changed)) == expected


def test_a_distance_is_told_with_the_limit_that_it_breaks() -> None:
    found = {
        distance: [one.limit for one in judge(replace(SOUND, geometry=replace(GEOMETRY, distance=distance)))]
        for distance in (40.0, 2e5)
    }
    assert found == {40.0: [50.0], 2e5: [100_000.0]}


def test_a_flight_is_kept_fixed_only_if_all_of_the_frame_is_known() -> None:
    """As a start it says how much of the frame shows nothing, and which lens does as well there."""
    limits = replace(LIMITS, edge_wanted_px=2.5)
    edge = replace(SOUND, proven=replace(PROVEN, edge_px=2.6), near=0.6, rival=(Solvable.RATIONAL, 2.4))
    assert [one.severity for one in judge(replace(edge, proven=replace(PROVEN, edge_px=2.5)), limits)] == [
        NOTE
    ]
    assert [(one.rule, one.severity) for one in judge(replace(SOUND, sound=(1.0, 0.9)), limits)] == [
        ("valid-region", UNPROVEN)
    ]
    (told,) = judge(edge, limits)
    assert (told.rule, told.severity, told.measured, told.limit) == ("uncertain-edge", UNPROVEN, 2.6, 2.5)
    assert "elsewhere (no corner was seen in 40% of the frame) the" in told.message
    (told_of_all,) = judge(replace(edge, near=0.999), limits)
    assert "elsewhere the" in told_of_all.message
    assert told.message.endswith("a rational lens explains the views as well, and differs by up to 2.4 px")


def test_a_part_without_a_direction_is_never_told_as_nothing() -> None:
    (told,) = judge(replace(SOUND, sound=(1.0, 220 / 221)))
    assert "gives 0.45% of the frame no direction" in told.message


def test_the_gravest_is_told_first() -> None:
    told = [one.severity for one in judge(replace(SOUND, near=0.0, kappa2=None, focus=None, repeats=2))]
    assert told == [ERROR, UNPROVEN, NOTE, NOTE]


def told_of_focal(**parts: float) -> tuple[str, str]:
    """The message and the remedy of a focal length with these parts of its standard deviation."""
    shifts = [(Part(name.replace("_", "-")), value) for name, value in parts.items() if name != "noise"]
    variance = sum(value**2 for value in parts.values())
    budget = budget_of(variance, 4.0, shifts, 20)
    (told,) = [one for one in judge(replace(SOUND, budget=budget)) if one.rule == "uncertain-focal-length"]
    assert told.remedy is not None
    return told.message, told.remedy


def test_the_remedy_of_an_uncertain_focal_length_is_that_of_its_largest_parts() -> None:
    message, remedy = told_of_focal(noise=0.0006, board_shape=0.0020, stretched_print=0.0015)
    assert message.endswith("0.20% from the shape of the board and 0.15% from the scale of the print")
    assert remedy == (
        "glue the print to glass or aluminium: 0.17% then; measure the print along both sides, and print it to scale: "
        "0.21% then"
    )


def test_noise_that_the_views_multiply_is_mended_by_views_that_agree() -> None:
    message, remedy = told_of_focal(noise=0.0016)
    assert message.endswith("0.16% from noise (0.08% × 2.0, as the views disagree)")
    assert remedy == "keep camera and board still, and the board flat: 0.08% then"


def test_plain_noise_asks_for_as_many_views_as_reach_the_limit() -> None:
    budget = budget_of(0.0015**2, 1.0, (), 20)
    (told,) = judge(replace(SOUND, kappa2=1.0, budget=budget))
    assert told.remedy == "take 45 views like these 20: 0.10% then"
