"""The sheet of labels: one for each unit, whose code a camera reads as the address of its page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest

from calibrary.errors import InputError
from calibrary.jobs.site.building import Site, build
from calibrary.jobs.site.labels import LABELS, check_address
from calibrary.known_camera import hash_serial
from calibrary.registry.init import init
from calibrary.registry.registry import Registry
from tests.jobs.site.fleet import save
from tests.registry.entries import an_entry

ADDRESS = "https://cameras.example.com/fleet/"
SERIALS = [hash_serial("DJI", f"0V2DE1R0A1000{number}") for number in range(3)]
UNITS = (
    an_entry(serial=SERIALS[0], label="P4R-01"),
    an_entry(serial=SERIALS[0], label="P4R-01", size=(4864, 3648)),
    an_entry(serial=SERIALS[1]),
    an_entry(serial=SERIALS[2], label="<b>"),
    an_entry(),
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    folder = tmp_path_factory.mktemp("labels")
    save(Registry.open(init(folder / "fleet").place), UNITS, "Import")
    return build(folder / "fleet", folder / "out", labels=check_address(ADDRESS), workers=1)


def labels(site: Site) -> list[str]:
    return (site.root / LABELS).read_text(encoding="utf-8").split("<li>")[1:]


def picture(label: str, scale: int = 6) -> np.ndarray[Any, Any]:
    """A code as printed: its path of strokes, each one module high."""
    box, path = re.search(r'viewBox="0 0 (\d+) \d+"', label), re.search(r' d="([^"]+)"', label)
    assert box is not None
    assert path is not None
    found = np.full((int(box[1]), int(box[1])), 255, np.uint8)
    x, y = 0.0, 0.0
    for step, first, second in re.findall(r"([Mmh])([-\d.]+)(?:[ ,]?([-\d.]+))?", path[1]):
        if step == "h":
            found[int(y), int(x) : int(x + float(first))] = 0
            x += float(first)
        else:
            x, y = (float(first), float(second)) if step == "M" else (x + float(first), y + float(second))
    return np.kron(found, np.ones((scale, scale), np.uint8))


def test_each_unit_has_a_label_whose_code_opens_its_page(site: Site) -> None:
    cv2 = pytest.importorskip("cv2")
    found = {}
    for label in labels(site):
        text, _, _ = cv2.QRCodeDetector().detectAndDecode(picture(label))
        assert text.startswith(ADDRESS)
        assert (site.root / unquote(text.removeprefix(ADDRESS))).is_file()
        found[text] = label
    assert len(found) == 3
    [first] = [address for address, label in found.items() if "P4R-01" in label]
    assert "/5472x3648" in first


def test_a_label_says_the_name_the_hash_of_the_serial_number_and_the_entry(site: Site) -> None:
    [first] = [label for label in labels(site) if "P4R-01" in label]
    assert re.search(
        r"<b>P4R-01</b>DJI FC6310R<br>sn-[0-9a-f]{8}<br>dji/fc6310r/sn-[0-9a-f]+/5472x3648", first
    )
    assert any("<b>&lt;b&gt;</b>" in label for label in labels(site))


@pytest.mark.parametrize(
    "address",
    [
        "cameras.example.com",
        "https://a b/",
        "https://h/?t=1",
        "https:////",
        "https://ada:word@h/",
        "https://h/\u202e",
        f"https://{'h' * 300}",
    ],
)
def test_an_address_that_is_none_or_too_long_for_a_label_is_refused(address: str) -> None:
    with pytest.raises(InputError, match="where the pages are served"):
        check_address(address)


def test_a_site_without_an_address_has_no_labels(registry: Path, tmp_path: Path) -> None:
    assert not (build(registry, tmp_path / "out", workers=1).root / LABELS).exists()
