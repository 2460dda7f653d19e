"""Changes of frame: no door hands out a K that is not the image's as one to keep, and none contradicts another."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pytest

from calibrary import Calibration, CameraKey, open_registry, write
from calibrary.arguments import Stated
from calibrary.calibration import Grade, Intrinsics, Provenance, Quality
from calibrary.distortion import BrownConrady
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.readings import readings
from calibrary.jobs.audit.age import Rule
from calibrary.jobs.fleet import create_registry
from calibrary.jobs.onboard.estimates import Serves
from calibrary.jobs.onboard.run import Onboarding
from calibrary.jobs.resolve import resolve
from calibrary.jobs.resolve.run import FleetAnswer
from calibrary.jobs.survey import Claim, Who
from calibrary.jobs.survey.placing import placed
from calibrary.jobs.survey.relating import gap, is_by_whole
from calibrary.quality import Covariance
from calibrary.records import replace
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.registry import Registry
from calibrary.validation import Severity
from tests.jobs.extract.fleet import picture
from tests.registry.entries import FILE, an_entry
from tests.registry.git.repositories import put, seclude
from tests.thorough import every

FULL, F = (5472, 3648), 3420.0
PX_PER_MM, FOCAL_MM = 411.26, 8.29
KNOWN, UNKNOWN = ("Yuneec", "E90"), ("Acme Aerial", "Cam20")


class Change(NamedTuple):
    """What a camera did to its frame.

    Attributes:
        size: of the images.
        fx: that is right, px.
        use: of the entry where the image states nothing of its frame.
        by_plane: where it states a focal plane that is right.
    """

    size: tuple[int, int]
    fx: float
    use: str
    by_plane: str


CHANGES: Final = {
    "same": Change(FULL, F, "fixed", "fixed"),
    "half": Change((2736, 1824), F / 2, "start", "fixed"),
    "scale 0.75": Change((4104, 2736), F * 0.75, "none", "fixed"),
    "crop 0.9": Change((4924, 3282), F, "none", "none"),
    "crop 0.8": Change((4378, 2918), F, "none", "none"),
    "crop 0.9 joined": Change((2462, 1642), F / 2, "none", "start"),
    "crop 16:9": Change((5472, 3078), F, "start", "start"),
    "crop 0.9 enlarged": Change(FULL, F / 0.9, "start", "none"),
    "turned": Change((3648, 5472), F, "start", "start"),
}
NOT_TOLD = {"crop 0.9 enlarged"}
"""Nothing in an image tells of these but a focal plane; the answer is a start, with what it takes for granted."""


class Asked(NamedTuple):
    """The image of a change, and the registry with the entry of the whole frame."""

    image: Path
    registry: str
    change: Change


@pytest.fixture
def asked(tmp_path: Path) -> Callable[..., Asked]:
    def ask(name: str, *, plane: bool, camera: tuple[str, str]) -> Asked:
        change = CHANGES[name]
        known = Quality(covariance=Covariance.from_matrix(("fx", "fy"), [[0.04, 0.04], [0.04, 0.04]]))
        entry = an_entry(
            make=camera[0],
            model=camera[1],
            focal_mm=FOCAL_MM,
            fx=F,
            size=FULL,
            quality=known,
            distortion=BrownConrady(k1=-0.1, k2=0.02, p1=0.0, p2=0.0),
            provenance=replace(FILE, firmware="1.04"),
        )
        path = tmp_path / "registry" / entry.path
        path.parent.mkdir(parents=True)
        path.write_bytes(entry_yaml(entry))
        tags: dict[str, Any] = {"software": "1.04" if name == "same" else "1.05"}
        if plane:
            per_mm = round(PX_PER_MM * change.fx / F * 100)
            tags |= {"focal_plane_resolution": ((per_mm, 100), (per_mm, 100)), "focal_plane_unit": 4}
        (tmp_path / "flight").mkdir()
        image = picture(
            tmp_path / "flight" / "a.jpg",
            change.size,
            make=camera[0],
            model=camera[1],
            focal_mm=(829, 100),
            pixel_size=change.size,
            **tags,
        )
        return Asked(image, f"folder:{tmp_path / 'registry'}", change)

    return ask


def answer(one: Asked) -> FleetAnswer:
    return resolve(one.image, registry=one.registry)


@pytest.mark.parametrize("camera", [UNKNOWN, KNOWN], ids=["unknown", "catalogued"])
@pytest.mark.parametrize("plane", [False, True], ids=["no plane", "plane"])
@pytest.mark.parametrize("name", CHANGES)
def test_resolve_gives_the_k_and_the_use_that_the_image_tells(
    asked: Callable[..., Asked], name: str, plane: bool, camera: tuple[str, str]
) -> None:
    one = asked(name, plane=plane, camera=camera)
    found = answer(one)
    assert found.use == (one.change.by_plane if plane else one.change.use), found.use_reason
    assert (found.calibration is None) is (found.use == "none")
    if found.calibration is not None and (plane or name not in NOT_TOLD):
        assert found.calibration.intrinsics.fx == pytest.approx(one.change.fx, rel=0.005)


def test_both_ks_of_a_crop_are_shown_with_what_would_decide(asked: Callable[..., Asked]) -> None:
    found = answer(asked("crop 0.9", plane=True, camera=UNKNOWN))
    assert [round(one.intrinsics.fx) for one in found.possible] == [3078, 3420]
    assert "EXIF FocalLength × FocalPlaneResolution states 3409" in (found.use_reason or "")
    assert found.remedy == "calibrate this image size, and register it"


CASES: Final = [
    (name, plane, camera) for name in CHANGES for plane in (False, True) for camera in (UNKNOWN, KNOWN)
]


@pytest.mark.parametrize(("name", "plane", "camera"), every(3, CASES))
def test_an_audit_gives_the_entry_the_k_that_resolve_gives_it(
    asked: Callable[..., Asked], name: str, plane: bool, camera: tuple[str, str]
) -> None:
    one = asked(name, plane=plane, camera=camera)
    resolved = answer(one)
    report = open_registry(one.registry).audit(one.image.parent, workers=1)
    [audited] = report.cameras
    against = {Rule.SIZE, Rule.DRIFT, Rule.TAGS} & {
        finding.rule for finding in report.findings if finding.severity is not Severity.NOTE
    }
    if resolved.calibration is None:
        assert against, report.findings
    else:
        assert audited.fx == resolved.calibration.intrinsics.fx
        assert not against & {Rule.DRIFT, Rule.TAGS}
    assert bool({Rule.SIZE} & against) is (one.change.size != FULL)


@pytest.mark.parametrize(
    ("name", "plane", "camera"),
    every(5, [case for case in CASES if case[0] in NOT_TOLD or case[2] == UNKNOWN]),
)
def test_onboard_proposes_the_k_that_was_measured_on_the_new_frame(
    asked: Callable[..., Asked],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    plane: bool,
    camera: tuple[str, str],
) -> None:
    seclude(monkeypatch, tmp_path)
    one = asked(name, plane=plane, camera=camera)
    size, fx = one.change.size, one.change.fx
    K = np.array([[fx, 0.0, size[0] / 2 + 2.0], [0.0, fx, size[1] / 2], [0.0, 0.0, 1.0]])
    measured = Calibration.from_opencv(K, np.array([-0.11, 0.02, 0.0, 0.0]), image_size=size)
    write(measured, one.image.parent / "camera.yml", format="opencv")
    fleet = tmp_path / "fleet"
    create_registry(fleet)
    [before] = (tmp_path / "registry").rglob("*.yaml")
    put(
        Registry.open(fleet).repo, {before.relative_to(tmp_path / "registry").as_posix(): before.read_bytes()}
    )
    done = Onboarding(
        folder=one.image.parent,
        registry=Registry.open(fleet),
        camera=CameraKey(),
        stated=Stated(),
        board=None,
        square_mm=None,
        serves=Serves.MODEL,
        ask=None,
        trusted=None,
        flight=False,
        label=None,
        workers=1,
        progress=None,
    ).run(None)
    [decided] = done.cameras
    if name in NOT_TOLD and camera == KNOWN:
        # The catalogue says otherwise of a frame of this size: it takes a person.
        assert decided.decision.value == "refused"
        return
    assert decided.entry is not None, decided.reason
    assert decided.entry.calibration.intrinsics.fx == pytest.approx(fx)
    assert decided.entry.calibration.intrinsics.image_size == size
    assert decided.decision.value != "refused", decided.reason


def test_what_is_of_the_whole_frame_is_compared_with_a_part_as_if_that_showed_all_of_it() -> None:
    size = CHANGES["crop 0.9"].size
    metadata = ImageMetadata(size=size)
    stated = Intrinsics(fx=F, fy=F, cx=FULL[0] / 2, cy=FULL[1] / 2, image_size=FULL)
    of_file, of_tag = (
        Calibration(
            camera=CameraKey(),
            intrinsics=K,
            grade=Grade.DERIVED,
            provenance=Provenance(kind="image-metadata"),
        )
        for K in (stated, stated.scaled(size))
    )
    cut = next(one for one in readings(stated, metadata) if one.is_cut)
    part = placed(Claim(who=Who.FILE, name="file", calibration=of_file), cut)
    [here] = readings(of_tag.intrinsics, metadata)
    whole = placed(Claim(who=Who.TAG, name="tag", is_whole=True, calibration=of_tag), here)
    assert abs(whole.fx / part.fx - 1.0) > 0.09
    assert gap(whole, part) == pytest.approx(0.0, abs=1e-3)
    assert is_by_whole(whole, part)
