"""The scene in which a camera state's sources are read, and the circumstances by which its K is validated."""

from __future__ import annotations

from calibrary.calibration import Intrinsics
from calibrary.catalogue.sensor_widths import sensor_width
from calibrary.errors import FrameError
from calibrary.evidence.collect import Evidence
from calibrary.evidence.context import Scene
from calibrary.evidence.edits import edits
from calibrary.evidence.estimate import Source, SourceEstimate
from calibrary.evidence.frame import RESIZED, adapt, files_frame
from calibrary.evidence.optics import is_part
from calibrary.jobs.extract.cameras import Sensor, State
from calibrary.jobs.extract.knowledge import Known
from calibrary.known_camera import SensorWidth
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.validation import Circumstances, Expected, NamedFocal

__all__ = ["circumstances", "named", "scene_of"]


def scene_of(state: State, sensor: Sensor, policy: Policy) -> Scene:
    """Make the scene in which a state's sources are read.

    For a camera that is neither in the catalogue nor in the registry, the sources are weighed against each
    other if the policy permits it. Only then are the sensor databases consulted.
    """
    sides, camera = sensor.sides(state.metadata), state.known.camera
    knows = camera is not None and (camera.pitch_um is not None or camera.fx_over_w is not None)
    weighs = policy.independent_sources_settle and not knows and state.known.calibration is None
    return Scene(
        metadata=state.metadata,
        known=camera,
        siblings=state.known.siblings,
        given_sensor_mm=sides if sensor.given else None,
        # For a known camera the default sensor size would be wrong.
        assumed_sensor_mm=None if sensor.given or knows or state.known.calibration is not None else sides,
        weighs=weighs,
        listed=_listed(state) if weighs else None,
    )


def _listed(state: State) -> SensorWidth | None:
    camera = state.known.camera
    if camera is not None and camera.sensor_width_mm is not None:
        return SensorWidth(camera.sensor_width_mm, "the catalogue")
    return sensor_width(state.metadata.make, state.metadata.model)


def circumstances(evidence: Evidence, known: Known, *, spread: float | None = None) -> Circumstances:
    """Make the circumstances of the chosen estimate of one image."""
    chosen = evidence.chosen
    metadata = evidence.scene.metadata
    causes = {conflict.other: conflict.cause.value for conflict in evidence.conflicts}
    return Circumstances(
        expected=_expected(evidence.scene, known),
        others=tuple(
            replace(named(estimate, chosen), cause=causes.get(estimate))
            for estimate in evidence.estimates
            if estimate is not chosen
        ),
        focal_mm=metadata.focal_mm,
        focal_35mm=metadata.focal_35mm,
        weighed=evidence.scene.weighs,
        resized=chosen is not None and RESIZED in chosen.assumptions,
        sensor_assumed=chosen is not None and chosen.source is Source.ASSUMED_SENSOR,
        sensor_given=chosen is not None and chosen.source is Source.GIVEN_SENSOR,
        zoom=evidence.scene.written.zoom,
        edits=tuple(f"the image was {edit}" for edit in edits(metadata)),
        spread=spread,
    )


def named(estimate: SourceEstimate, chosen: SourceEstimate | None) -> NamedFocal:
    """The focal length of an estimate, with what is needed to compare it with the chosen one."""
    return NamedFocal(
        name=estimate.tag,
        fx=estimate.intrinsics.fx,
        tolerance=estimate.tolerance,
        independent=chosen is None or estimate.is_independent_of(chosen),
        confirms_within=estimate.confirms_within(chosen) if chosen is not None else None,
    )


def _expected(scene: Scene, known: Known) -> Expected | None:
    """The known camera's fx at the file's image size; None if unknown."""
    if known.resolution is not None:
        return Expected(
            fx=known.resolution.calibration.intrinsics.fx,
            tolerance=known.resolution.entry.tolerance,
            source="registry",
            entry=known.resolution.path,
        )
    camera, metadata = known.camera, scene.written
    over_width = camera.fx_over_w_at(metadata.focal_mm) if camera is not None else None
    if camera is None or over_width is None or camera.native_size is None:
        return None
    width, height = camera.native_size
    focal = over_width * width
    if is_part(scene, focal, camera.native_size):
        width, height = files_frame(metadata)
    native = Intrinsics(fx=focal, fy=focal, cx=width / 2, cy=height / 2, image_size=(width, height))
    try:
        fx = adapt(native, metadata).intrinsics.fx
    except FrameError:
        return None
    return Expected(fx=fx, spread=camera.spread, source="catalogue", by_exif_focal=camera.fx_over_w is None)
