"""What a person states of images that do not state it themselves: their camera, and their focal length."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from msgspec import Struct

from calibrary.catalogue import camera_named
from calibrary.errors import InputError, UsageError
from calibrary.evidence.context import Source
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.extract.cameras import Camera, JudgedState
from calibrary.jobs.images.accumulator import ByDay
from calibrary.records import replace


class Stated(Struct, frozen=True, kw_only=True):
    """What is stated of the images that lack it.

    Attributes:
        camera: Model or title in the catalogue, of images without a Model.
        focal_mm: focal length, of images without one.
        sensor: whether the size of their sensor is stated too.
    """

    camera: str | None = None
    focal_mm: float | None = None
    sensor: bool = False

    def added(self, states: Mapping[ImageMetadata, ByDay]) -> Mapping[ImageMetadata, ByDay]:
        """The images with what they lack.

        Raises:
            UsageError: no image lacks it, or the catalogue has no such camera.
        """
        if self.camera is not None:
            states = self._with_camera(states)
        if self.focal_mm is not None:
            if all(one.focal_mm is not None for one in states):
                raise UsageError("--focal-mm has no effect: every image states its focal length")
            states = {self._with_focal(one): days for one, days in states.items()}
        return states

    def _with_camera(self, states: Mapping[ImageMetadata, ByDay]) -> Mapping[ImageMetadata, ByDay]:
        assert self.camera is not None  # noqa: S101  the caller's condition
        if all(one.model is not None for one in states):
            raise UsageError("--camera has no effect: every image states its Model")
        try:
            known = camera_named(self.camera)
        except InputError as error:
            raise UsageError(f"--camera: {error.message}") from None
        wanted = self.camera.strip().casefold()
        model = next((one for one in known.names if one.casefold() == wanted), known.names[0])
        return {
            replace(one, make=known.make, model=model, lens=known.lens, stated=one.stated | {"camera"})
            if one.model is None
            else one: days
            for one, days in states.items()
        }

    def _with_focal(self, one: ImageMetadata) -> ImageMetadata:
        if one.focal_mm is not None:
            return one
        return replace(one, focal_mm=self.focal_mm, stated=one.stated | {"focal"})

    def check(self, cameras: Iterable[Camera]) -> None:
        """Check that what was stated made a difference.

        Raises:
            UsageError: it gives no K, not even one that is refused.
        """
        judged = [one for camera in cameras for one in camera.judged]
        found: set[Source] = set()
        for one in judged:
            found.update(estimate.source for estimate in one.evidence.estimates)
            found.update(dropped.source for dropped in one.evidence.dropped)
        if self.focal_mm is not None and Source.STATED not in found:
            raise UsageError(
                "--focal-mm has no effect: the sensor is unknown; add --sensor-width-mm, or --camera"
            )
        if self.sensor and self.focal_mm is None and Source.GIVEN_SENSOR not in found:
            raise UsageError(
                "--sensor-width-mm has no effect: no image states a focal length; add --focal-mm"
            )
        self._check_camera(judged)

    def _check_camera(self, judged: Sequence[JudgedState]) -> None:
        named = [one for one in judged if "camera" in one.state.metadata.stated]
        for one in named:
            known = one.state.known
            if known.camera is None or self.camera is None or known.camera != camera_named(self.camera):
                raise UsageError(f"--camera {self.camera}: the images do not fit it: {known.why}")
        if named and not any(one.evidence.estimates or one.evidence.dropped for one in named):
            raise UsageError(
                f"--camera {self.camera}: the catalogue has no fixed focal length; add --focal-mm"
            )
