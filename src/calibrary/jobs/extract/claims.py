"""The claim about a camera, from image tags and the catalogue, that its pixels are compared with."""

from __future__ import annotations

from pathlib import Path

from calibrary.errors import InputError
from calibrary.jobs.extract.cameras import DEFAULT_SENSOR_MM, Camera, Sensor, group_cameras
from calibrary.jobs.extract.judging import judge
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.images.accumulator import undated
from calibrary.known_camera import Projection
from calibrary.parsers.imagery import read_metadata
from calibrary.policy import FLEET
from calibrary.sfm.as_stated import Claim

__all__ = ["claim_of", "claim_of_image"]


def claim_of(camera: Camera) -> Claim | None:
    """The claim about a camera; None without a K, or with a K from an assumed sensor size."""
    state = camera.states[0]
    known = state.known.camera
    if camera.calibration is None or camera.evidence.chosen is None or not camera.calibration.grade.is_metric:
        return None
    return Claim(
        K=camera.calibration,
        zoom=state.metadata.zoom,
        native_size=known.native_size if known is not None else None,
        fisheye=known is not None and known.projection is Projection.FISHEYE,
    )


def claim_of_image(path: Path) -> Claim | None:
    """The claim about the camera that took an image; None if the image cannot be read."""
    try:
        states = undated({read_metadata(path): [path.name]})
    except InputError:
        return None
    sensor = Sensor(size_mm=DEFAULT_SENSOR_MM, given=False)
    cameras = [
        camera
        for key, group in group_cameras(states, Knowledge.load(None)).items()
        for camera in judge(key, group, policy=FLEET, sensor=sensor)
    ]
    return claim_of(cameras[0]) if cameras else None
