"""Ground control in an adjustment: what it settles, and what is wrong with it by labelled cases."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from calibrary.calib.least_squares import marginal, reduce
from calibrary.calib.lens_models import Solvable
from calibrary.errors import CalibrationError, InputError, ParseError
from calibrary.records import replace
from calibrary.sfm.adjust import Adjustment, adjust
from calibrary.sfm.assessment import flight_result
from calibrary.sfm.bundle import linearise
from calibrary.sfm.control import on_control, with_survey
from calibrary.sfm.image_selection import select_images
from calibrary.sfm.sigma import covariance
from calibrary.sfm.survey import Survey
from calibrary.sfm.tracks import Scene, Tracks
from calibrary.validation import Use
from tests.sfm.flights import CAMERA, PLANS, Plan, fly
from tests.sfm.surveyed import DATUM, FRAME, survey
from tests.sfm.test_image_selection import strip

SMALL = Plan(relief=0.05, heights=(1.0, 1.4), cross=True, rows=2, columns=4, points=150, outliers=0.0)
SEED = 3


@cache
def flown(plan: Plan = SMALL) -> tuple[Tracks, Scene]:
    return fly(plan, SEED)


def adjusted(given: Survey, plan: Plan = SMALL, *, positions: bool = True) -> Adjustment:
    tracks, scene = flown(plan)
    tracks = tracks if positions else replace(tracks, positions=None)
    return adjust(*with_survey(tracks, scene, given, FRAME), model=Solvable.BROWN)


@pytest.mark.parametrize("std_m", [np.inf, 0.5])
def test_points_and_offset_are_eliminated_as_a_dense_solution_would(std_m: float) -> None:
    tracks, scene = fly(replace(SMALL, points=70), 2)
    given = replace(survey(replace(SMALL, points=70), 2), offset_std_m=std_m)
    tracks, scene = with_survey(tracks, scene, given, FRAME)
    assert tracks.control is not None
    scene = on_control(tracks, scene, tracks.control, shared_frame=True)
    linear = linearise(tracks, scene, 0.25)
    assert linear is not None
    assert tracks.control is not None
    n, views, points = len(tracks.point), len(tracks.names), np.unique(tracks.point, return_inverse=True)[1]
    first = 9 + 6 * views
    dense = np.zeros((n, 2, first + 3 * (points.max() + 1) + 3))
    dense[..., :9] = linear.by_lens
    rows = np.arange(n)
    for axis in range(6):
        dense[rows, :, 9 + 6 * tracks.image + axis] = linear.kept.jac[..., axis]
    for axis in range(3):
        dense[rows, :, first + 3 * points + axis] = linear.gone[..., axis]
    A = dense.reshape(2 * n, -1)
    # A position observes a centre and the offset of all; a survey observes a point.
    places = np.zeros((3 * views, A.shape[1]))
    at = np.arange(3 * views)
    places[at, 9 + 6 * (at // 3) + 3 + at % 3] = places[at, A.shape[1] - 3 + at % 3] = (
        linear.priors.by_place.ravel()
    )
    N = A.T @ A + places.T @ places
    known = np.searchsorted(np.unique(tracks.point), tracks.control.point)
    at = first + (3 * known[:, None] + np.arange(3)).ravel()
    N[at, at] += 0.25 / 0.03**2
    N[-3:, -3:] += np.eye(3) * 0.25 / np.hypot(std_m, 5.0) ** 2
    scale = np.sqrt(np.diag(N))
    whole = np.linalg.inv(N / np.outer(scale, scale))[:9, :9] / np.outer(scale[:9], scale[:9])
    matrix, _, _ = marginal(reduce(linear, np.arange(9)), 9)
    std = np.sqrt(np.diag(whole))
    np.testing.assert_allclose(
        np.linalg.inv(matrix) / np.outer(std, std), whole / np.outer(std, std), atol=1e-4
    )


@pytest.mark.parametrize("positions", [True, False])
def test_the_world_is_where_the_points_are(positions: bool) -> None:
    found = adjusted(survey(SMALL, SEED), positions=positions)
    assert found.control is not None
    assert (found.control.points, found.control.rejected) == (6, ())
    assert found.control.rms_px < 2.0
    assert found.control.rms_m < 0.06
    assert (
        abs(found.bundle.scene.parameters[0] - CAMERA.intrinsics.fx)
        < 4 * covariance(found.bundle)[0, 0] ** 0.5
    )
    if positions:
        # Heights of another system, and what an ordinary receiver is off by itself.
        assert found.control.offset_m is not None
        np.testing.assert_allclose(found.control.offset_m, -np.array(DATUM), atol=25.0)
    else:
        assert found.control.offset_m is None


@pytest.mark.thorough
def test_sigma_is_smaller_with_points_of_different_heights_and_the_datum() -> None:
    plan = replace(PLANS["relief, one height"], gps_m=(0.02, 0.03), points=300)
    alone = covariance(adjust(*flown(plan), model=Solvable.BROWN).bundle)[0, 0] ** 0.5
    level = survey(plan, SEED, datum=(0.0, 0.0, 0.0))
    free = covariance(adjusted(level, plan).bundle)[0, 0] ** 0.5
    same = covariance(adjusted(replace(level, offset_std_m=0.05), plan).bundle)[0, 0] ** 0.5
    assert same < 0.9 * free < 0.9 * alone


def test_flat_ground_from_one_height_is_refused_with_points_on_it_too() -> None:
    plan = replace(PLANS["flat, one height"], points=300)
    found = flight_result(adjusted(replace(survey(plan, SEED), offset_std_m=0.02), plan))
    assert found.verdict is Use.NONE
    assert "focal-length-or-height" in {finding.rule for finding in found.findings}
    assert found.flown is not None
    assert found.flown.control is not None


# What is wrong with the points: who is left out, or what is said


def mark(given: Survey, row: int, **by: object) -> Survey:
    marks = list(given.marks)
    marks[row] = replace(marks[row], **by)
    return replace(given, marks=tuple(marks))


def click(given: Survey) -> Survey:
    x, y = given.marks[3].pixel
    return mark(given, 3, pixel=(x + 14, y - 9))


def other_image(given: Survey) -> Survey:
    taken = {one.image for one in given.marks if one.point == given.marks[0].point}
    return mark(given, 0, image=next(name for name in flown()[0].names if name not in taken))


def one_of_two(given: Survey) -> Survey:
    others = [one for one in given.marks if one.point != 4]
    of_point = [one for one in given.marks if one.point == 4][:2]
    x, y = of_point[0].pixel
    return replace(given, marks=(*others, replace(of_point[0], pixel=(x + 30, y + 25)), of_point[1]))


def swapped(given: Survey) -> Survey:
    order = [1, 0, 2, 3, 4, 5]
    return replace(given, places=given.places[order])


def coordinate(given: Survey) -> Survey:
    places = given.places.copy()
    places[4, 2] += 1.0
    return replace(given, places=places)


@pytest.mark.parametrize(
    ("case", "points", "positions"),
    [
        (click, 6, True),
        (other_image, 6, False),
        (swapped, 4, False),
        (coordinate, 5, True),
        (one_of_two, 5, True),
    ],
)
def test_what_is_wrong_is_left_out_by_name(
    case: Callable[[Survey], Survey], points: int, positions: bool
) -> None:
    given = survey(SMALL, SEED)
    wrong = case(given)
    found = adjusted(wrong, positions=positions)
    assert found.control is not None
    assert found.control.points == points
    assert found.control.rms_m < 0.08
    named = {(one.point, one.image) for one in found.control.rejected}
    if points == 6:
        at = 3 if case is click else 0
        assert {point for point, _ in named} == {given.names[given.marks[at].point]}
        assert len(named) == 1
    else:
        assert {point for point, _ in named} == ({"GCP1", "GCP2"} if case is swapped else {"GCP5"})
        assert len(named) == sum(
            given.names[one.point] in {point for point, _ in named} for one in wrong.marks
        )
    finding = next(one for one in flight_result(found).findings if one.rule == "marks-rejected")
    assert found.control.rejected[0].image in finding.message
    assert (
        abs(found.bundle.scene.parameters[0] - CAMERA.intrinsics.fx)
        < 4 * covariance(found.bundle)[0, 0] ** 0.5
    )


def in_feet(given: Survey) -> Survey:
    middle = given.places.mean(axis=0)
    return replace(given, places=middle + (given.places - middle) * 3.2808)


def moved(given: Survey) -> Survey:
    return replace(given, places=given.places + np.array([0.05, 0.0, 0.0]))


def mixed_up(given: Survey) -> Survey:
    return replace(given, places=given.places[[3, 5, 0, 1, 2, 4]])


def mirrored(given: Survey) -> Survey:
    middle = given.places.mean(axis=0)
    return replace(given, places=middle + (given.places - middle) * (1, -1, 1))


def in_a_line(given: Survey) -> Survey:
    # The middles of two sides of the points' hexagon, and nothing else.
    return replace(given, places=given.places * (1, 0, 0) + (0, given.places[0, 1], given.places[0, 2]))


def elsewhere(given: Survey) -> Survey:
    return replace(given, marks=tuple(replace(one, image=f"DJI{one.image}") for one in given.marks))


def few(given: Survey) -> Survey:
    return replace(given, marks=tuple(one for one in given.marks if one.point < 2))


@pytest.mark.parametrize(
    ("case", "problem"),
    [
        (in_feet, r"3\.[23]\d times as large as by the images' positions: check the points' unit"),
        (moved, "3.8 km from where the images were taken: check the coordinate system"),
        (mixed_up, "surveyed points fit"),
        (mirrored, "surveyed points fit|below the ground"),
        (in_a_line, "lie in one line"),
        (
            elsewhere,
            "gcp_list.txt marks DJIIMG_.* and others, none of the images that fit together, such as IMG_0000",
        ),
        (few, "2 points of gcp_list.txt are marked in two of the 16 images each, need 3"),
    ],
)
def test_points_of_another_place_or_unit_are_refused(case: Callable[[Survey], Survey], problem: str) -> None:
    plan = replace(SMALL, gps_m=(1.5, 2.5)) if case is not in_feet else replace(SMALL, gps_m=(0.02, 0.03))
    with pytest.raises(CalibrationError, match=problem):
        adjusted(case(survey(plan, SEED)), plan)


def test_a_mark_outside_its_image_is_refused_by_its_line() -> None:
    with pytest.raises(ParseError, match=r"line 6: the mark in IMG_.* is outside its 1500×1000 px"):
        adjusted(mark(survey(SMALL, SEED), 4, pixel=(2100.0, 10.0)))


def test_points_of_no_map_lay_down_the_world_without_positions() -> None:
    given, middle = survey(SMALL, SEED), (-0.3, 12.0, 4.0)
    local = replace(given, places=FRAME.metres(given.places) + middle, is_local=True)
    found = adjusted(local)
    assert found.control is not None
    assert (found.control.points, found.control.offset_m) == (6, None)
    assert found.bundle.tracks.positions is None
    assert found.bundle.tracks.control is not None
    there = found.bundle.scene.points[found.bundle.tracks.control.point]
    np.testing.assert_allclose(there, local.places, atol=0.1)
    with pytest.raises(InputError, match="--same-datum-m needs images"):
        adjusted(replace(local, offset_std_m=0.1))


def test_points_worse_than_stated_count_for_less() -> None:
    found = adjusted(replace(survey(SMALL, SEED, std_m=0.25, mark_px=2.0), std_m=0.05, mark_px=1.0))
    assert found.control is not None
    assert 1.5 < found.control.worse < 8.0
    assert found.control.points >= 4
    assert "points-less-certain" in {one.rule for one in flight_result(found).findings}


def test_images_that_show_several_points_are_chosen() -> None:
    images = strip("a", 200, up=500.0)
    shown = {f"a{at:03}": frozenset({at % 4}) for at in range(150, 170)}
    plain, chosen = select_images(images, 30), select_images(images, 30, shown)
    unplaced = select_images([replace(one, fix=None) for one in images], 30, shown)
    for one, enough in ((plain, False), (chosen, True), (unplaced, True)):
        seen = [shown.get(image.name, frozenset()) for image in one.images]
        assert all(sum(point in points for points in seen) >= 2 for point in range(4)) is enough
