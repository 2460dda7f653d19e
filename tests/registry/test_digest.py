"""The digest seals the numbers: halves of two calibrations never pass for a whole one."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.errors import ParseError
from calibrary.quality import Covariance, Quality
from calibrary.records import replace
from calibrary.registry.entry import Entry, Sensor, Status, digest
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from tests.registry.entries import LENS, a_content, covariance


def of(entry: Entry) -> str:
    return digest(entry.calibration, entry.sensor)


def test_it_is_the_same_today_as_when_it_was_first_written() -> None:
    assert of(a_content()) == "sha256:f72b27057ee998cfb1defd9db975a4e52e8540672151da4bd5a88e2f0310cc74"


@pytest.mark.parametrize(
    "other",
    [
        a_content(fx=3661.2500000000005),
        a_content(distortion=replace(LENS, k3=-0.0311)),
        a_content(distortion=None),
        a_content(distortion=NoDistortion()),
        a_content(size=(5472, 3646)),
        a_content(sensor=Sensor(width_mm=13.2)),
        a_content(quality=Quality(std={"fx": 0.4})),
        a_content(quality=Quality(covariance=covariance())),
    ],
)
def test_every_number_of_the_calibration_counts(other: Entry) -> None:
    assert of(other) != of(a_content())


@pytest.mark.parametrize(
    "other",
    [
        a_content(status=Status.RETIRED, reason="sold", notes=("seen",)),
        a_content(quality=Quality(rms_px=0.3, views=12, kappa2=1.2)),
        a_content(model="FC6310S", serial="9f2c"),
        a_content(distortion=BrownConrady(k3=-0.031, p2=-0.0002, p1=0.0007, k2=0.104, k1=-0.262)),
        a_content(quality=Quality(std={})),
    ],
)
def test_what_is_no_number_of_it_does_not(other: Entry) -> None:
    assert of(other) == of(a_content())


def test_the_order_of_a_covariance_does_not_matter() -> None:
    there = covariance(("fx", "fy", "cx"))
    back = Covariance.from_matrix(("cx", "fy", "fx"), np.asarray(there.matrix)[::-1, ::-1])
    digests = {of(a_content(quality=Quality(covariance=each))) for each in (there, back)}
    assert len(digests) == 1


def test_minus_zero_is_zero() -> None:
    assert of(a_content(distortion=replace(LENS, p1=0.0))) == of(a_content(distortion=replace(LENS, p1=-0.0)))


class Checkout:
    """A git repository with one entry, driven by git itself."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.file = folder, folder / "entry.yaml"
        self.git("init", "--quiet", "--initial-branch=main")
        self.commit(a_content())

    def git(self, *words: str) -> int:
        names = {f"GIT_{who}_{what}": "a@b" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
        environment = {
            **os.environ,
            **names,
            "GIT_CONFIG_GLOBAL": os.devnull,
            "GIT_CONFIG_SYSTEM": os.devnull,
        }
        done = subprocess.run(
            ["git", *words], cwd=self.folder, env=environment, capture_output=True, check=False
        )
        return done.returncode

    def commit(self, entry: Entry, *, sealed: bool = True) -> None:
        lines = entry_yaml(entry).splitlines(keepends=True)
        self.file.write_bytes(b"".join(line for line in lines if sealed or not line.startswith(b"digest:")))
        assert self.git("add", ".") == 0
        assert self.git("commit", "--quiet", "-m", "entry") == 0


def test_one_branchs_k_and_the_others_distortion_do_not_merge_into_a_camera_nobody_measured(
    tmp_path: Path,
) -> None:
    checkout = Checkout(tmp_path)
    checkout.git("checkout", "-q", "-b", "new-k")
    checkout.commit(a_content(fx=3700.0))
    checkout.git("checkout", "-q", "-b", "new-lens", "main")
    checkout.commit(a_content(distortion=replace(LENS, k3=-0.04)))
    assert checkout.git("merge", "--quiet", "new-k") == 1
    merged = checkout.file.read_text()
    assert "<<<<<<<" in merged
    with pytest.raises(ParseError):
        parse_entry(merged.encode(), "entry.yaml")
    for side in ("<<<<<<< ", "=======", ">>>>>>> "):
        merged = "\n".join(line for line in merged.split("\n") if not line.startswith(side))
    first, second = (line for line in merged.splitlines() if line.startswith("digest:"))
    for kept, dropped in ((first, second), (second, first)):
        by_hand = merged.replace(f"{dropped}\n", "", 1)
        assert kept in by_hand
        with pytest.raises(ParseError, match="put two calibrations together"):
            parse_entry(by_hand.encode(), "entry.yaml")


def test_without_the_digest_git_would_have_joined_them_in_silence(tmp_path: Path) -> None:
    checkout = Checkout(tmp_path)
    checkout.commit(a_content(), sealed=False)
    checkout.git("checkout", "-q", "-b", "new-k")
    checkout.commit(a_content(fx=3700.0), sealed=False)
    checkout.git("checkout", "-q", "-b", "new-lens", "main")
    checkout.commit(a_content(distortion=replace(LENS, k3=-0.04)), sealed=False)
    assert checkout.git("merge", "--quiet", "--no-edit", "new-k") == 0
    joined = parse_entry(checkout.file.read_bytes(), "entry.yaml", require_digest=False)
    assert joined == a_content(fx=3700.0, distortion=replace(LENS, k3=-0.04))
