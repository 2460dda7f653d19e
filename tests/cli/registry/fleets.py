"""Short ways to the registry's commands, and calibration files of our own to give them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import main
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import StoredEntry
from calibrary.schemas import require

P4R = "dji/fc6310r/5472x3648"
CAMERA = ("--make", "DJI", "--model", "FC6310R")


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    """The exit code of ``calibrary registry …``, and what it said on both streams."""
    capsys.readouterr()
    code = main(["registry", *map(str, arguments)])
    said = capsys.readouterr()
    return code, said.out, said.err


def printed(capsys: pytest.CaptureFixture[str], schema: str, *arguments: str | Path) -> Any:
    """The document that a command prints with ``--json``, once its schema has let it through."""
    _, out, _ = run(capsys, *arguments, "--json")
    document = json.loads(out)
    require(document, schema)
    return document


def xml(path: Path, f: float = 3660.5, size: tuple[int, int] = (5472, 3648), cx: float = -4.5) -> Path:
    """A calibration as Metashape exports it, which names no camera."""
    path.write_text(
        f"<calibration><projection>frame</projection><width>{size[0]}</width><height>{size[1]}</height>"
        f"<f>{f}</f><cx>{cx}</cx><cy>7.25</cy><k1>-0.1</k1><p1>0.001</p1></calibration>"
    )
    return path


def add(path: Path, *arguments: str, camera: tuple[str, ...] = CAMERA) -> None:
    """Put a file into the registry."""
    assert main(["registry", "add", str(path), *camera, "--yes", *arguments]) == 0


def looked_at(fleet: Path, *keys: str, rev: str | None = None) -> list[str]:
    """KEYs with the digests of what is proposed for them, as ``approve`` takes them from somebody who has looked."""
    pending = [Registry.open(fleet).snapshot(rev).filed(key) for key in keys]
    digests = [word for one in pending if one.is_pending for word in ("--digest", str(one.oid)[:12])]
    return [*keys, *digests]


def held(fleet: Path, key: str = P4R) -> StoredEntry:
    """An entry as it stands."""
    return Registry.open(fleet).get(key)


def commit_of(fleet: Path) -> str:
    """Where the registry stands."""
    return Registry.open(fleet).commit()
