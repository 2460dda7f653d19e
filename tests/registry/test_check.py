"""What is wrong with a registry is found whole, each thing with its place, and nothing stops the search."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from calibrary.calibration import Provenance
from calibrary.policy import FLEET, SOURCE
from calibrary.quality import Covariance, Quality
from calibrary.records import replace
from calibrary.registry.checks import check_all
from calibrary.registry.entry import UNSTATED, Alias, Entry, Sensor, Status, Validity
from calibrary.registry.entry_checks import check
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.registry import open_snapshot
from calibrary.strictyaml import YamlValue
from calibrary.validation import Finding, Severity
from tests.registry.entries import LENS, an_entry, covariance


def files(*entries: Entry) -> dict[str, Entry]:
    return {entry.path: entry for entry in entries}


def in_folder(folder: Path, tree: Mapping[str, bytes]) -> tuple[Finding, ...]:
    """What is found in a folder of files."""
    for path, data in tree.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(data)
    return check_all(open_snapshot(Path(f"folder:{folder}"))).findings


def found(findings: tuple[Finding, ...]) -> list[tuple[str, str]]:
    return [(finding.rule, finding.severity.value) for finding in findings]


def of(*entries: Entry) -> list[tuple[str, str]]:
    return found(check(files(*entries), FLEET))


def test_a_good_registry_has_no_findings() -> None:
    good = (
        an_entry(quality=Quality(covariance=covariance(), std=covariance().std)),
        an_entry(serial="9f2c", sensor=Sensor(width_mm=13.2, height_mm=8.8, pitch_um=2.41)),
        an_entry(status=Status.DRAFT, model="FC220", provenance=UNSTATED),
        an_entry(firmware=FirmwareRange(max="1.4")),
        an_entry(firmware=FirmwareRange(min="1.5")),
        an_entry(model="FC9330", aliases=(Alias(make="DJI", model="Phantom 4"),)),
        an_entry(
            model="FC9330",
            size=(4000, 3000),
            fx=2290.0,
            focal_mm=3.61,
            distortion=None,
            aliases=(Alias(make="DJI", model="Phantom 4"),),
        ),
        an_entry(model="FC300", supersedes="dji/fc200/5472x3648+f8.8"),
        an_entry(model="FC200", status=Status.RETIRED),
        an_entry(model="Oppo Rеnо", make="ОРРО"),
    )
    findings = check(files(*good), FLEET)
    assert [str(finding) for finding in findings if finding.rule != "spelling"] == []
    assert not any(finding.severity is Severity.ERROR for finding in findings)


def test_an_empty_registry_is_good() -> None:
    assert check({}, FLEET) == ()


def test_nothing_stops_at_the_first(tmp_path: Path) -> None:
    good = (an_entry(), an_entry(model="FC220", provenance=UNSTATED, fx=100.0, distortion=None))
    tree = {entry.path: entry_yaml(entry) for entry in good}
    tree["cameras/dji/a/1x1.yaml"] = b"{"
    tree["cameras/dji/b/1x1.yaml"] = tree[an_entry().path].replace(b"fx: 3661.25", b"fx: 3700.0")
    tree["cameras/dji/c/1x1.yaml"] = tree[an_entry().path]
    tree["cameras/dji/d/1x1.yaml"] = b"schema: calibrary/entry-9\n"
    findings = in_folder(tmp_path, tree)
    assert [((finding.place or '').split("/")[2], finding.rule) for finding in findings] == [
        ("a", "entry"), ("b", "entry"), ("c", "entry"), ("d", "entry"), ("fc220", "focal-plausibility"),
        ("fc220", "focal-symmetry"), ("fc220", "provenance"),
    ]  # fmt: skip
    for finding in findings:
        assert str(finding).count(finding.place or "") == 1


def test_an_entry_must_lie_where_its_key_says() -> None:
    [(path, data)] = files(an_entry()).items()
    [finding] = check({"cameras/dji/fc6310r/other.yaml": data}, FLEET)
    assert finding.rule == "path"
    assert path in finding.message


@pytest.mark.parametrize(("status", "expected"), [(Status.APPROVED, 1), (Status.DRAFT, 0)])
def test_what_is_approved_says_where_it_is_from(status: Status, expected: int) -> None:
    assert of(an_entry(status=status, provenance=UNSTATED)) == [("provenance", "error")] * expected


def test_what_is_not_plausible_is_an_error_if_approved_and_a_warning_in_a_draft() -> None:
    assert of(an_entry(fx=100.0, distortion=None))[0] == ("focal-plausibility", "error")
    assert of(an_entry(fx=100.0, distortion=None, status=Status.DRAFT))[0] == (
        "focal-plausibility",
        "warning",
    )
    folding = replace(LENS, k1=-1.5, k2=0.0)
    assert of(an_entry(distortion=folding)) == [("distortion-monotonic", "error")]


def test_an_entry_from_an_image_is_not_held_to_the_band_of_unknown_cameras() -> None:
    tele = an_entry(
        model="Unheard Of",
        fx=5472 * 2.6,
        focal_mm=24.0,
        provenance=Provenance(kind="image-metadata", source="a", tag="b"),
    )
    assert of(tele) == []
    assert found(check(files(tele), SOURCE)) == [("focal-plausibility", "error")]


@pytest.mark.parametrize(
    "sensor",
    [Sensor(width_mm=36.0), Sensor(pitch_um=4.4), Sensor(width_mm=13.2, pitch_um=4.8)],
)
def test_a_sensor_that_does_not_go_with_k_is_seen(sensor: Sensor) -> None:
    assert of(an_entry(sensor=sensor)) == [("sensor", "warning")]


@pytest.mark.parametrize(
    "quality",
    [
        Quality(covariance=Covariance(names=("fx", "fy"), upper=(1.0, 2.0, 1.0))),
        Quality(std={"k7": 0.1}),
        Quality(covariance=covariance(("fx", "s1"))),
    ],
)
def test_an_uncertainty_that_is_none_is_an_error(quality: Quality) -> None:
    assert of(an_entry(quality=quality)) == [("uncertainty", "error")]


@pytest.mark.parametrize("std", [0.01, 1.0, 100.0])
def test_a_std_beside_a_covariance_is_its_root_to_a_thousandth(std: float) -> None:
    stated = Covariance.from_matrix(("fx", "fy"), np.diag([std**2, 1.0]))
    for share, expected in ((1.0005, []), (0.9995, []), (1.002, [("uncertainty", "error")])):
        quality = Quality(covariance=stated, std={"fx": share * std})
        assert of(an_entry(quality=quality)) == expected


class TestOneCamera:
    """Entries of one camera do not stand in one another's way."""

    def test_ranges_of_firmware_do_not_overlap(self) -> None:
        one, other = (
            an_entry(firmware=FirmwareRange(min="1.0", max="1.5")),
            an_entry(firmware=FirmwareRange(min="1.4")),
        )
        assert ("overlap", "error") in of(one, other)
        assert of(replace(one, status=Status.RETIRED), other) == []
        early, late = Validity(last=date(2025, 12, 31)), Validity(first=date(2026, 1, 1))
        assert of(replace(one, validity=early), replace(other, validity=late)) == []

    def test_ranges_that_cannot_be_compared_are_said(self) -> None:
        other = an_entry(firmware=FirmwareRange(min="ILCE 1.4"))
        [finding] = check(files(an_entry(firmware=FirmwareRange(min="1.0")), other), FLEET)
        assert finding.rule == "overlap"
        assert "cannot be compared" in finding.message

    def test_every_entry_is_reached_by_its_own_key(self) -> None:
        wide = an_entry(sub_camera="wide"), an_entry(sub_camera="WideCamera")
        assert of(*wide) == [("reachable", "error")] * 2
        shadow = an_entry(focal_mm=24.0), an_entry(focal_mm=None, lens="24 mm")
        assert of(*shadow) == []


class TestAliases:
    """A name leads to one camera."""

    ALIAS = Alias(make="DJI", model="Phantom 4")

    def test_a_name_that_has_entries_of_its_own_is_no_alias(self) -> None:
        alias = Alias(make="DJI", model="Roamer")
        assert of(an_entry(aliases=(alias,)), an_entry(model="roamer ")) == [("alias", "error")]

    def test_two_cameras_do_not_share_an_alias(self) -> None:
        assert of(an_entry(aliases=(self.ALIAS,)), an_entry(model="FC2", aliases=(self.ALIAS,))) == [
            ("alias", "error")
        ]

    def test_its_own_name_is_no_alias(self) -> None:
        assert of(an_entry(aliases=(Alias(make="dji", model="fc6310r"),))) == [("alias", "error")]


class TestSuccession:
    """What an entry supersedes is there, and retired."""

    def test_the_one_superseded_must_be_there(self) -> None:
        assert of(an_entry(supersedes="dji/fc220/5472x3648+f8.8")) == [("supersedes", "error")]

    def test_the_one_superseded_must_be_retired(self) -> None:
        assert of(an_entry(supersedes=an_entry(model="FC220").id), an_entry(model="FC220")) == [
            ("supersedes", "error")
        ]

    def test_nothing_supersedes_itself(self) -> None:
        assert of(an_entry(supersedes=an_entry().id)) == [("supersedes", "error")]


def test_a_name_of_two_scripts_is_a_warning() -> None:
    assert of(an_entry(model="Rеno 3")) == [("spelling", "warning")]


def test_a_unit_whose_make_images_write_in_other_letters_is_a_warning() -> None:
    assert of(an_entry(make="dji", serial="27634db88229fa80")) == [("spelling", "warning")]
    assert of(an_entry(make="dji")) == []


def test_a_character_that_turns_the_direction_of_a_line_is_a_warning(tmp_path: Path) -> None:
    turned = entry_yaml(an_entry()).replace(b"grade:", "# \u202e 5.2 mm\ngrade:".encode())
    assert found(in_folder(tmp_path, {an_entry().path: turned})) == [("spelling", "warning")]


def test_a_warning_leaves_a_registry_good() -> None:
    findings = check(files(an_entry(model="Rеno 3")), FLEET)
    assert [finding.severity for finding in findings] == [Severity.WARNING]


@pytest.mark.parametrize(("status", "rules"), [(Status.APPROVED, ["board"]), (Status.DRAFT, [])])
def test_a_calibration_that_was_refused_is_not_put_to_use(status: Status, rules: list[str]) -> None:
    block: YamlValue = {"verdict": "none", "reasons": ["low-tilt"]}
    refused = replace(an_entry(status=status), extensions={"x-board-calibration": block})
    assert [rule for rule, _ in of(refused)] == rules


@pytest.mark.parametrize("verdict", ["fixed", "start"])
def test_a_calibration_may_be_put_to_use_as_what_it_was_judged(verdict: str) -> None:
    assert of(replace(an_entry(), extensions={"x-board-calibration": {"verdict": verdict}})) == []
