"""OPF's project: the cameras of the files that it lists, as these files give them by themselves."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.errors import MissingTagError, ParseError
from tests.parsers.formats.test_opf_calibrated_cameras import PERSPECTIVE, document, input_cameras
from tests.parsers.formats.test_opf_input_cameras import document as input_document
from tests.parsers.formats.test_opf_input_cameras import sensor
from tests.parsers.samples import Sample

CALIBRATED, INPUT = "application/opf-calibrated-cameras+json", "application/opf-input-cameras+json"
SIZES = ((5472, 3648), (2736, 1824))


def project(*resources: tuple[str, str]) -> bytes:
    items = [
        {"id": uri, "type": "any", "resources": [{"format": mark, "uri": uri}]} for mark, uri in resources
    ]
    generator = {"name": "PIX4Dmatic", "version": "1.41.0"}
    fields = {"format": "application/opf-project+json", "version": "1.0", "generator": generator}
    return json.dumps({**fields, "items": items}).encode()


SAMPLES = {
    "opf_project": Sample(project((INPUT, "in.json")), beside={"in.json": input_document(sensor())}),
}


def read(data: bytes, beside: Mapping[str, bytes]) -> Sequence[Calibration]:
    return parsers.decode(data, name="mission.opf", companion=beside.get)


def test_the_cameras_are_those_of_the_calibration_with_the_sizes_of_the_input_cameras() -> None:
    data = project((INPUT, "in/cameras.json"), (CALIBRATED, "out/flight%201.json"))
    found = read(
        data,
        {"in/cameras.json": input_cameras(*SIZES), "out/flight 1.json": document(PERSPECTIVE, PERSPECTIVE)},
    )
    assert [item.intrinsics.image_size for item in found] == list(SIZES)
    assert [item.intrinsics.fx for item in found] == [3650.1, 3650.1]
    made = found[0].provenance
    assert (made.source, made.tool) == ("mission.opf", "PIX4Dmatic 1.41.0")
    assert [file.name for file in made.sources] == ["out/flight 1.json"]


def test_of_a_project_without_a_calibration_the_input_cameras_are_read() -> None:
    data = input_document(sensor(), sources=("database",))
    [item] = read(project((INPUT, "in.json")), {"in.json": data})
    alone = parsers.decode(data, name="in.json")[0]
    assert (item.intrinsics, item.distortion, item.grade) == (
        alone.intrinsics,
        alone.distortion,
        Grade.DESIGN,
    )


def test_a_size_that_no_file_states_is_asked_for() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        read(project((CALIBRATED, "out.json")), {"out.json": document(PERSPECTIVE)})


def test_a_part_of_the_lens_that_is_not_understood_refuses_the_project_as_it_does_the_file() -> None:
    odd = document(PERSPECTIVE | {"radial_k7": 0.3})
    with pytest.raises(ParseError, match="radial_k7"):
        read(
            project((INPUT, "in.json"), (CALIBRATED, "o.json")),
            {"o.json": odd, "in.json": input_cameras(SIZES[0])},
        )


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (project(), "no cameras"),
        (project((CALIBRATED, "a.json"), (CALIBRATED, "b.json")), "a.json, b.json"),
        (project((CALIBRATED, "a.json")), "not beside it"),
        (project((CALIBRATED, "bad.json")), "bad.json"),
    ],
)
def test_a_project_whose_cameras_are_not_one_readable_file_says_so(data: bytes, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(data, {"bad.json": document(PERSPECTIVE)[:-4]})


def test_no_resource_outside_of_the_projects_folder_is_opened(tmp_path: Path) -> None:
    (tmp_path / "secret.json").write_bytes(document(PERSPECTIVE))
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "p.opf").write_bytes(project((CALIBRATED, "../secret.json")))
    with pytest.raises(ParseError, match="not a file beside it"):
        parsers.read(tmp_path / "inner" / "p.opf")
