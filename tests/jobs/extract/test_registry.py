"""The fleet's registry: which entry answers for a camera, and which may not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import main
from calibrary.errors import RegistryError
from calibrary.jobs.extract.extraction import JudgedCamera
from calibrary.registry.locking import Lock, lock_yaml, pin_of
from calibrary.validation import Verdict
from tests.jobs.extract.fleet import P4R, entry, files, gate, only, picture

STRIPPED: dict[str, Any] = {"make": "DJI", "model": "FC6310R"}


def served(folder: Path, **tags: Any) -> JudgedCamera:
    """What the registry beside the flight makes of one image without a focal length."""
    picture(folder / "flight/a.jpg", **(STRIPPED | tags))
    return only(gate(folder / "flight", registry=files(folder / "registry")))


def fx(camera: JudgedCamera) -> float | None:
    """By the entry that is used; None if it is the catalogue's lens."""
    found = camera.calibration
    return found.intrinsics.fx if found is not None and found.provenance.kind != "image-metadata" else None


def test_an_entry_somebody_answers_for_is_used(tmp_path: Path) -> None:
    entry(tmp_path / "registry")
    assert fx(served(tmp_path)) == 3661.25


def test_two_entries_that_fit_alike_are_an_error_that_names_both(tmp_path: Path) -> None:
    entry(tmp_path / "registry", focal_mm=8.8)
    entry(tmp_path / "registry", focal_mm=24.0)
    with pytest.raises(RegistryError, match=r"5472x3648\+f24\.yaml, .*5472x3648\+f8\.8\.yaml"):
        served(tmp_path)


def test_a_camera_whose_entry_is_refused_is_named_and_every_other_one_goes_on(tmp_path: Path) -> None:
    path = entry(tmp_path / "registry")
    path.write_text(path.read_text() + f'digest: "sha256:{"0" * 64}"\n')
    entry(tmp_path / "registry", model="FC330", fx=3650.0)
    picture(tmp_path / "flight/a.jpg", **STRIPPED)
    picture(tmp_path / "flight/b.jpg", **(STRIPPED | {"model": "FC330"}))
    report = gate(tmp_path / "flight", registry=files(tmp_path / "registry"))
    assert [(one.camera.key.model, fx(one)) for one in report.judged] == [("FC330", 3650.0)]
    [refused] = report.rejected
    assert refused.name == "a.jpg"
    assert "cameras/dji/fc6310r/5472x3648.yaml: digest" in refused.reason
    assert not report.is_good


def test_the_entry_of_this_unit_wins_over_that_of_its_model(tmp_path: Path) -> None:
    entry(tmp_path / "registry", fx=3661.25)
    serial = served(tmp_path, body_serial="4711").camera.key.serial
    entry(tmp_path / "registry", fx=3655.5, serial=serial)
    assert fx(served(tmp_path, body_serial="4711")) == 3655.5
    assert fx(served(tmp_path, body_serial="4712")) == 3661.25


def test_an_entry_of_one_firmware_serves_no_other(tmp_path: Path) -> None:
    entry(tmp_path / "registry", fx=3661.25)
    entry(tmp_path / "registry", fx=3655.5, firmware='"01.09"')
    assert fx(served(tmp_path, software="01.09")) == 3655.5
    assert fx(served(tmp_path, software="01.10")) == 3661.25
    assert fx(served(tmp_path)) == 3661.25


def test_a_camera_with_two_firmwares_is_not_served_by_the_entry_of_one(tmp_path: Path) -> None:
    entry(tmp_path / "registry", firmware='"01.09"')
    picture(tmp_path / "flight/b.jpg", **STRIPPED, software="01.10")
    camera = served(tmp_path, software="01.09")
    assert fx(camera) is None
    assert camera.fallback is not None
    assert "firmware" in camera.fallback.steps[-1].why


@pytest.mark.parametrize(
    "stated", [{"model": "FC6310S"}, {"make": "Hasselblad"}, {"sub_camera": "thermal"}, {"lens": "other"}]
)
def test_what_an_entry_states_must_be_so(tmp_path: Path, stated: dict[str, Any]) -> None:
    entry(tmp_path / "registry", **stated)
    assert fx(served(tmp_path)) is None


def test_letter_case_does_not_matter(tmp_path: Path) -> None:
    entry(tmp_path / "registry", make="dji", model="fc6310r")
    assert fx(served(tmp_path)) == 3661.25


def test_an_entry_is_scaled_to_the_image(tmp_path: Path) -> None:
    entry(tmp_path / "registry", fx=1830.5, image_size=(2736, 1824))
    assert fx(served(tmp_path)) == 3661.0


def test_a_zoomed_frame_is_another_camera_unless_the_entry_says_it(tmp_path: Path) -> None:
    entry(tmp_path / "registry")
    assert fx(served(tmp_path, digital_zoom=(2, 1))) is None
    entry(tmp_path / "registry", fx=7300.0, capture_mode='"zoom 2×"')
    assert fx(served(tmp_path, digital_zoom=(2, 1))) == 7300.0


def test_a_good_k_of_the_images_is_measured_against_the_entry(tmp_path: Path) -> None:
    entry(tmp_path / "registry", fx=3661.25)
    picture(tmp_path / "flight/a.jpg", **P4R)
    camera = only(gate(tmp_path / "flight", registry=files(tmp_path / "registry")))
    assert camera.verdict is Verdict.VALID
    assert camera.outranked is camera.camera.calibration
    entry(tmp_path / "registry", fx=3900.0)
    camera = only(gate(tmp_path / "flight", registry=files(tmp_path / "registry")))
    assert camera.camera.reason is not None
    assert "cameras/dji/fc6310r/5472x3648.yaml states fx" in camera.camera.reason


def test_no_registry_is_an_error_and_not_an_empty_one(tmp_path: Path) -> None:
    with pytest.raises(RegistryError, match="cameras"):
        served(tmp_path)


@pytest.mark.parametrize(
    ("found", "place"),
    [("grade: calibrated", "grade"), ("fx: 3661.25, ", "fx"), ("schema: calibrary/entry-1", "schema")],
)
def test_a_broken_entry_is_named(tmp_path: Path, found: str, place: str) -> None:
    path = entry(tmp_path / "registry")
    path.write_text(path.read_text().replace(found, "", 1))
    with pytest.raises(RegistryError, match=rf"cameras/dji/fc6310r/5472x3648\.yaml.*{place}"):
        served(tmp_path)


class TestTolerance:
    """An entry may ask for more or less than the policy's 3 % of whatever claims to be its camera."""

    @pytest.mark.parametrize(
        ("tolerance", "fx", "valid"),
        [(None, 3740.0, True), (0.01, 3740.0, False), (None, 3900.0, False), (0.08, 3900.0, True)],
    )
    def test_the_entrys_own_comes_before_the_policys(
        self, tmp_path: Path, tolerance: float | None, fx: float, valid: bool
    ) -> None:
        path = entry(tmp_path / "registry", fx=fx)
        if tolerance is not None:
            path.write_text(path.read_text() + f"tolerance: {tolerance}\n")
        picture(tmp_path / "flight/a.jpg", **P4R)
        camera = only(gate(tmp_path / "flight", registry=files(tmp_path / "registry")))
        assert (camera.camera.verdict is Verdict.VALID) is valid


def test_an_entry_out_of_its_days_is_not_used_and_said_to_be_near(tmp_path: Path) -> None:
    path = entry(tmp_path / "registry")
    path.write_text(path.read_text() + "validity: {until: 2020-01-01}\n")
    fallback = served(tmp_path).fallback
    assert fallback is not None
    assert fallback.calibration is None
    assert (
        "cameras/dji/fc6310r/5472x3648.yaml does not apply: it is valid until 2020-01-01, not on"
        in fallback.steps[-1].why
    )


def test_what_was_taken_says_why(tmp_path: Path) -> None:
    entry(tmp_path / "registry", fx=1830.5, image_size=(2736, 1824))
    fallback = served(tmp_path).fallback
    assert fallback is not None
    assert fallback.steps[-1].why.endswith(
        "cameras/dji/fc6310r/2736x1824.yaml is of this model; scaled 2736×1824 → 5472×3648"
    )


def test_a_digest_that_does_not_fit_stops_the_run(tmp_path: Path) -> None:
    path = entry(tmp_path / "registry")
    path.write_text(path.read_text() + f'digest: "sha256:{"0" * 64}"\n')
    with pytest.raises(RegistryError, match=r"cameras/dji/fc6310r/5472x3648\.yaml: digest"):
        served(tmp_path)


class TestLocked:
    """With a lock a run rests on the entries that are pinned, as they were, or does not run."""

    @staticmethod
    def locked(folder: Path) -> JudgedCamera:
        picture(folder / "flight/a.jpg", **STRIPPED)
        return only(
            gate(folder / "flight", registry=files(folder / "registry"), lock=folder / "calibrary.lock")
        )

    @staticmethod
    def lock(folder: Path, *paths: Path) -> None:
        pins = (pin_of(path.relative_to(folder / "registry").as_posix(), path.read_bytes()) for path in paths)
        (folder / "calibrary.lock").write_bytes(lock_yaml(Lock(pins=tuple(pins))))

    def test_what_is_pinned_is_used_and_nothing_newer(self, tmp_path: Path) -> None:
        self.lock(tmp_path, entry(tmp_path / "registry"))
        entry(tmp_path / "registry", fx=3700.0, sub_camera="rgb")
        assert fx(self.locked(tmp_path)) == 3661.25

    def test_a_pinned_entry_that_changed_stops_the_run(self, tmp_path: Path) -> None:
        self.lock(tmp_path, entry(tmp_path / "registry"))
        entry(tmp_path / "registry", fx=3700.0)
        with pytest.raises(
            RegistryError, match=r"differs from .*calibrary\.lock: cameras/dji/fc6310r/5472x3648\.yaml"
        ):
            self.locked(tmp_path)

    def test_a_pinned_entry_that_is_gone_stops_the_run(self, tmp_path: Path) -> None:
        path = entry(tmp_path / "registry")
        self.lock(tmp_path, path)
        path.unlink()
        with pytest.raises(RegistryError, match="no longer in the registry"):
            self.locked(tmp_path)

    def test_the_command_says_so_in_one_line(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        self.lock(tmp_path, entry(tmp_path / "registry"))
        picture(tmp_path / "flight/a.jpg", **STRIPPED)
        monkeypatch.chdir(tmp_path)
        command = [
            "extract",
            "--image-dir",
            "flight",
            "--registry",
            "folder:registry",
            "--locked",
            "--dry-run",
        ]
        assert main(command) == 0
        entry(tmp_path / "registry", fx=3700.0)
        assert main(command) == 4
        assert capsys.readouterr().err.count("the registry differs from calibrary.lock") == 1

    def test_a_lock_without_its_registry_is_not_understood(self) -> None:
        assert main(["extract", "--locked"]) == 4
