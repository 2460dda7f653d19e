"""Changes of frame at every door that hands out a K, takes one, or judges one: none contradicts another."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import pytest
from starlette.datastructures import UploadFile

from calibrary import FLEET, Calibration, check, extract, open_registry, write
from calibrary.calibration import Intrinsics
from calibrary.cli.main import main
from calibrary.jobs.desk.guard import Keys
from calibrary.jobs.desk.pages import Asked as Request
from calibrary.jobs.desk.pages import Pages
from calibrary.jobs.extract.calibration_files import Rightness
from calibrary.jobs.survey.known import contradictions
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.validation import Severity
from tests.jobs.survey.test_matrix import CASES, KNOWN, NOT_TOLD, Asked, F, answer, asked
from tests.thorough import every

__all__ = ["asked"]


class Given(NamedTuple):
    """What a door says of the entry's K.

    Attributes:
        use: what a solver may do with it.
        fx: of the K that is handed out; None if none is.
    """

    use: str | None
    fx: float | None


def given(use: str | None, calibration: Calibration | None) -> Given:
    return Given(use, round(calibration.intrinsics.fx, 6) if calibration is not None else None)


def show(one: Asked, capsys: pytest.CaptureFixture[str]) -> Given:
    capsys.readouterr()
    code = main(["registry", "show", str(one.image), "--registry", one.registry, "--json"])
    found = json.loads(capsys.readouterr().out)
    assert code == (1 if found["use"] == "none" else 0)
    K = found["calibration"]
    return Given(found["use"], round(K["intrinsics"]["fx"], 6) if K is not None else None)


def extracted(one: Asked) -> Given:
    """The entry's K where extract falls back on it; what the images state themselves is right, or for no solver."""
    [camera] = extract(one.image.parent, registry=one.registry, workers=1, dry_run=True).cameras
    assert camera.use is not None
    K = camera.calibration
    is_entry = K is not None and K.provenance.kind == "registry" and camera.use.use.value != "none"
    if K is not None and not is_entry and camera.use.use.value != "none":
        assert camera.use.use.value == "start"
        assert K.intrinsics.fx == pytest.approx(one.change.fx, rel=0.005)
    return given(camera.use.use.value, K) if is_entry else Given("none", None)


def looked_up(one: Asked, scratch: Path) -> str:
    """The title of the desk's answer to an image."""
    pages = Pages(Path(one.registry), Keys(), scratch)
    try:
        image = UploadFile(BytesIO(one.image.read_bytes()), filename="a.jpg")
        return pages._look_at(Request(path={}, fields={"image": image}, is_form=True)).sections[0].title
    finally:
        pages.close()


@pytest.mark.parametrize(("name", "plane", "camera"), every(5, CASES))
def test_every_door_gives_one_k_and_one_use(
    asked: Callable[..., Asked],
    name: str,
    plane: bool,
    camera: tuple[str, str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    one = asked(name, plane=plane, camera=camera)
    resolved, opened = answer(one), open_registry(one.registry).resolve(one.image)
    found = given(resolved.use, resolved.calibration)
    assert (given(opened.use, opened.calibration), show(one, capsys), extracted(one)) == (found, found, found)
    assert looked_up(one, tmp_path) == ("The K to use" if found.fx is not None else "No K to use")
    if found.use == "fixed":
        assert found.fx == pytest.approx(one.change.fx, rel=0.005)


def measured(one: Asked, fx: float, old: Entry) -> Calibration:
    """The entry's camera as a board would measure it on the changed frame, with this fx."""
    (W, H), by = one.change.size, fx / F
    K = Intrinsics(
        fx=fx, fy=fx - 2.5 * by, cx=W / 2 - 4.5 * by, cy=H / 2 + 7.25 * by, image_size=one.change.size
    )
    if H > W:
        K = replace(K, fx=K.fy, fy=K.fx, cx=W / 2 - 7.25 * by, cy=H / 2 - 4.5 * by)
    key = replace(old.calibration.camera, image_size=one.change.size)
    return replace(old.calibration, camera=key, intrinsics=K)


def refused(calibration: Calibration, old: Entry) -> Iterator[str]:
    """The rules by which ``registry add`` takes it by force only."""
    new = replace(old, calibration=calibration)
    before = old if new.path == old.path else None
    for one in contradictions(new.path, new, {old.path: old}, before, FLEET):
        if one.severity is Severity.ERROR:
            yield one.rule


UNTOLD = {"scale 0.75", "crop 0.9", "crop 0.8", "crop 0.9 joined"}
"""Without a focal plane these may as well be scaled as cut: a file with the K of either is neither right nor off."""


@pytest.mark.parametrize(("name", "plane", "camera"), every(7, CASES))
def test_the_right_k_is_called_right_and_taken_and_a_wrong_one_off(
    asked: Callable[..., Asked], name: str, plane: bool, camera: tuple[str, str], tmp_path: Path
) -> None:
    one = asked(name, plane=plane, camera=camera)
    [file] = (tmp_path / "registry").rglob("*.yaml")
    old = parse_entry(file.read_bytes(), file.name, require_digest=False)
    scaled = F * one.change.size[0] / max(5472, one.change.size[0])
    wrong = scaled if abs(scaled / one.change.fx - 1.0) > 0.05 else one.change.fx / 0.9
    right = measured(one, one.change.fx, old)
    files = [tmp_path / "right.yml", tmp_path / "wrong.yml"]
    for K, path in zip((right, measured(one, wrong, old)), files, strict=True):
        write(K, path, format="opencv")
    said = [each.verdict for each in check(one.image.parent, files, registry=one.registry, workers=1).files]
    if plane or name not in UNTOLD | NOT_TOLD:
        # The catalogue takes an enlarged crop for the whole frame, and the focal plane does not.
        is_disputed = name in NOT_TOLD and camera == KNOWN
        assert said == [Rightness.UNKNOWN if is_disputed else Rightness.RIGHT, Rightness.OFF]
    elif name in UNTOLD:
        # The wrong K is that of the whole frame scaled, but for the scaled one: it is of no reading.
        off = Rightness.OFF if name == "scale 0.75" else Rightness.UNKNOWN
        assert said == [Rightness.UNKNOWN, off]
    if name not in NOT_TOLD:
        assert not [*refused(right, old)]
