"""How short a KEY may be, and what is said of a file that is listed and cannot be had."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.errors import RegistryError, UnknownCameraError
from calibrary.registry.init import init
from calibrary.registry.paths import find_path
from calibrary.registry.proposals import message_of
from calibrary.registry.registry import Registry
from tests.registry.entries import an_entry, put_entries
from tests.registry.git.repositories import nobodys_git

__all__ = ["nobodys_git"]

MODEL = "cameras/dji/m30t/4000x3000.yaml"
ONE = "cameras/dji/m30t/sn-0e25aa/4000x3000+sub-wide.yaml"
OTHER = "cameras/dji/m30t/sn-0f77bb/4000x3000+sub-wide.yaml"


@pytest.mark.parametrize(
    ("key", "path"),
    [
        ("m30t/sn-0e25", ONE),
        ("dji/m30t/sn-0e25", ONE),
        ("m30t/SN-0E25/4000", ONE),
        ("m30t/sn-0f", OTHER),
        ("dji/m30t/4000x3000", MODEL),
    ],
)
def test_a_unit_is_named_by_the_beginning_of_its_hash(key: str, path: str) -> None:
    assert find_path([MODEL, ONE, OTHER], key) == path


def test_what_fits_several_units_names_them() -> None:
    with pytest.raises(RegistryError, match=r"sn-0e25aa.*sn-0f77bb"):
        find_path([ONE, OTHER], "m30t/sn-0")
    with pytest.raises(UnknownCameraError):
        find_path([ONE, OTHER], "m30t/sn-1")


def test_a_content_that_is_missing_is_not_a_file_that_is_not_there(tmp_path: Path) -> None:
    registry = Registry.open(init(tmp_path / "fleet", bare=True).place)
    entry = an_entry()
    put_entries(registry, [(entry, None)], message_of("Add", [entry]))
    oid = registry.snapshot().paths[entry.path]
    assert oid is not None
    (tmp_path / "fleet/objects" / oid[:2] / oid[2:]).unlink()
    registry.repo.close()
    snapshot = type(registry).open(tmp_path / "fleet").snapshot()
    with pytest.raises(RegistryError, match=f"lacks the content of a file, object {oid}"):
        snapshot.committed(entry.path)


@pytest.mark.parametrize(
    ("key", "nearest"),
    [
        ("dij/fc6310", "dji/fc6310"),
        ("fc6310x", "dji/fc6310"),
        ("model-0777", "make_7/model-00777"),
        ("q", None),
    ],
)
def test_among_very_many_cameras_the_nearest_are_named(key: str, nearest: str | None) -> None:
    paths = [f"cameras/make_{n % 10}/model-{n:05}/4000x3000.yaml" for n in range(2000)]
    with pytest.raises(UnknownCameraError) as refused:
        find_path([*paths, "cameras/dji/fc6310/5472x3648.yaml"], key)
    message = str(refused.value)
    assert nearest in message if nearest is not None else "nearest" not in message
