"""The image circle of a fisheye, by what no frame ever lights; and frames that only look as if they had one."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.arrays import FloatArray
from calibrary.calib.image_circle import brightness, find_circle
from calibrary.quality import ImageCircle

SIZE = (960, 600)
CIRCLE = ImageCircle(x=470.0, y=310.0, radius=380.0)
X, Y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)


def scene(seed: int, lit: FloatArray, floor: float = 8.0) -> FloatArray:
    """A frame with rectangles of any brightness, seen only where it is lit."""
    rng = np.random.default_rng(seed)
    shown = np.full(X.shape, 60.0)
    for _ in range(40):
        x, y, w, h = rng.integers(0, (*SIZE, 300, 200))
        shown[y : y + h, x : x + w] = rng.uniform(20, 250)
    return brightness((floor + shown * lit + rng.normal(0, 2, X.shape)).clip(0, 255).astype(np.uint8))


def within(circle: ImageCircle) -> FloatArray:
    away = np.hypot(X - circle.x, Y - circle.y)
    return np.asarray(np.clip((circle.radius - away) / 12.0 + 1, 0, 1))


def test_the_circle_is_measured_where_the_frame_cuts_it_too() -> None:
    found = find_circle([scene(seed, within(CIRCLE)) for seed in range(12)], SIZE)
    assert found is not None
    assert (found.x, found.y, found.radius) == pytest.approx((CIRCLE.x, CIRCLE.y, CIRCLE.radius), abs=12)


def test_a_glare_outside_the_circle_in_one_frame_does_no_harm() -> None:
    frames = [scene(seed, within(CIRCLE)) for seed in range(12)]
    frames[3][:20, :20] = 250.0
    assert find_circle(frames, SIZE) is not None


def test_a_landing_leg_across_the_circle_does_not_move_it() -> None:
    seen = within(CIRCLE) * ~((np.abs(Y - 200) < 60) & (X < 400))
    found = find_circle([scene(seed, seen) for seed in range(8)], SIZE)
    assert found is not None
    assert (found.x, found.y, found.radius) == pytest.approx((CIRCLE.x, CIRCLE.y, CIRCLE.radius), abs=12)


@pytest.mark.parametrize(
    "lit",
    [
        np.ones(X.shape),
        # Vignetting is dark in the corners, and shows them.
        1.0 - 0.6 * (np.hypot(X - 480, Y - 300) / 566) ** 2,
        # A lit table in a dark room.
        ((np.abs(X - 480) < 300) & (np.abs(Y - 300) < 200)).astype(np.float64),
        # A circle at the frame's side is something in the scene.
        within(ImageCircle(x=250.0, y=300.0, radius=200.0)),
        np.zeros(X.shape),
    ],
    ids=["full frame", "vignetting", "dark room", "lamp", "lens cap"],
)
def test_what_is_no_image_circle(lit: FloatArray) -> None:
    assert find_circle([scene(seed, lit) for seed in range(8)], SIZE) is None


def test_without_frames_nothing_is_known() -> None:
    assert find_circle([], SIZE) is None
