"""Policies of one's own, and limits that are typed in place of a policy's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import main
from calibrary.errors import InputError, ParseError
from calibrary.policy import FLEET, SOURCE
from calibrary.policy_file import read_policy
from calibrary.records import replace
from tests.jobs.extract.fleet import NOBODY, P4R, picture


def policy_file(folder: Path, text: str) -> Path:
    path = folder / "ours.yaml"
    path.write_text(f"schema: calibrary/policy-1\nname: ours\n{text}")
    return path


def test_what_it_does_not_say_is_fleets(tmp_path: Path) -> None:
    policy = read_policy(policy_file(tmp_path, "focal_symmetry_max: 0.01\n"))
    assert policy == replace(FLEET, name="ours", focal_symmetry_max=0.01)


def test_or_that_of_the_base_it_names(tmp_path: Path) -> None:
    assert read_policy(policy_file(tmp_path, "base: source\n")) == replace(SOURCE, name="ours")


def test_every_limit_can_be_said(tmp_path: Path) -> None:
    text = (
        "focal_symmetry_max: 0.1\nfocal_symmetry_proven: null\nprincipal_point_drift_max: 0.02\n"
        "focal_over_width: [0.5, 2]\nmeasured_over_width: null\nknown_camera_tolerance: 0.01\n"
        "independent_sources_settle: false\nsource_agreement: 0.02\nskew_max: 0\ngroup_spread_max: 0.001\n"
        "assumed_sensor_is_unproven: false\ndistortion_monotonic: false\n"
    )
    policy = read_policy(policy_file(tmp_path, text))
    assert policy.focal_over_width == (0.5, 2)
    assert (policy.focal_symmetry_proven, policy.measured_over_width) == (None, None)
    assert (policy.known_camera_tolerance, policy.group_spread_max) == (0.01, 0.001)
    truths = (
        policy.independent_sources_settle,
        policy.assumed_sensor_is_unproven,
        policy.distortion_monotonic,
    )
    assert truths == (False, False, False)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("focal_symetry_max: 0.1\n", "did you mean focal_symmetry_max"),
        ("focal_symmetry_max: 15\n", "line 3, focal_symmetry_max: 15, expected at most 1"),
        ("skew_max: -0.1\n", "line 3, skew_max"),
        ("focal_over_width: [0.8]\n", "focal_over_width"),
        ("focal_over_width: [1.5, 0.8]\n", "focal_over_width"),
        ("group_spread_max: .nan\n", "line 3: .nan is not a finite number"),
        ("base: lenient\n", "'fleet' or 'source'"),
        ("independent_sources_settle: 1\n", "independent_sources_settle"),
        ("skew_max: 0.1\nskew_max: 0.2\n", "skew_max"),
        ("skew_max: [\n", "line"),
        ("a: *b\n", "line"),
    ],
    ids=[
        "unknown key",
        "per cent for a fraction",
        "below nought",
        "half a band",
        "band turned round",
        "no number",
        "unknown base",
        "number for a truth",
        "said twice",
        "no YAML",
        "alias",
    ],
)
def test_what_is_wrong_is_said_with_its_place(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_policy(policy_file(tmp_path, text))


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\0\0", b"- a\n- b\n", b"name: x\n", b"x" * (1 << 21)])
def test_what_is_no_policy_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "ours.yaml").write_bytes(content)
    with pytest.raises(ParseError):
        read_policy(tmp_path / "ours.yaml")


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"skew_max": 2.0}, "skew_max: 2.0, expected at most 1"),
        ({"drift_max_px": -1.0}, "drift_max_px: -1.0, expected at least 0"),
        ({"group_spread_max": float("nan")}, "group_spread_max: nan, expected a finite number"),
        ({"measured_over_width": (0.0, 2.0)}, "measured_over_width: 0.0, expected more than 0"),
        ({"focal_over_width": (1.5, 0.8)}, "focal_over_width is .* the lower before the higher"),
    ],
    ids=["fraction", "pixels", "no number", "band", "band turned round"],
)
def test_one_made_in_python_keeps_the_bounds_that_its_fields_declare(
    limits: dict[str, Any], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        replace(FLEET, **limits)


def test_a_policy_that_is_not_there_is_told_with_those_that_are(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fleet, source"):
        read_policy(tmp_path / "flet")


class TestOnTheCommandLine:
    @pytest.fixture(autouse=True)
    def _folder(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)

    def extract(self, *flags: str) -> int:
        return main(["extract", "--dry-run", *flags])

    def test_a_file_decides(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        picture(tmp_path / "input/a.jpg", **NOBODY)
        policy_file(tmp_path, "assumed_sensor_is_unproven: false\n")
        assert self.extract() == 1
        assert self.extract("--policy", "ours.yaml") == 0
        assert "ours" in capsys.readouterr().out

    def test_a_file_that_is_wrong_ends_with_3(self, tmp_path: Path) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        policy_file(tmp_path, "limit: 3\n")
        assert self.extract("--policy", "ours.yaml") == 3

    def test_a_typed_limit_stands_in_for_the_policys(self, tmp_path: Path) -> None:
        picture(tmp_path / "input/a.jpg", **NOBODY)
        sensor = ("--sensor-width-mm", "13.2", "--sensor-height-mm", "8.9")
        assert self.extract(*sensor) == 0
        assert self.extract(*sensor, "--max-focal-deviation-pct", "1") == 1
        policy_file(tmp_path, "focal_symmetry_max: 0.01\n")
        assert self.extract(*sensor, "--policy", "ours.yaml") == 1
        assert self.extract(*sensor, "--policy", "ours.yaml", "--max-focal-deviation-pct", "15") == 0

    def test_a_default_that_is_not_typed_does_not(self, tmp_path: Path) -> None:
        picture(tmp_path / "input/a.jpg", **NOBODY)
        policy_file(tmp_path, "focal_symmetry_max: 0.2\nfocal_symmetry_proven: 0.2\n")
        sensor = ("--sensor-width-mm", "13.2", "--sensor-height-mm", "10.7", "--policy", "ours.yaml")
        assert self.extract(*sensor) == 0
        assert self.extract(*sensor, "--max-focal-deviation-pct", "15.0") == 1
