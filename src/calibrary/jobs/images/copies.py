"""Paths for modified copies of images, and protection against overwriting."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from calibrary.errors import InputError
from calibrary.jobs.images.folders import find_images

__all__ = ["places_of_copies", "refuse_overwriting"]


def places_of_copies(images: Sequence[Path], out: Path) -> Iterator[tuple[Path, Path]]:
    """Yield each image with the path of its copy, at the same relative path in ``out`` as in the given folder.

    Raises:
        InputError: a folder contains no image or cannot be read.
    """
    target = out.resolve()
    for path in images:
        if not path.is_dir():
            yield path, out / path.name
            continue
        found = [one for one in find_images(path, recursive=True) if target not in one.resolve().parents]
        if not found:
            raise InputError("holds no image", source=str(path))
        for image in found:
            yield image, out / image.relative_to(path)


def refuse_overwriting(
    copies: Sequence[tuple[Path, Path]], *, done: str, force: bool, also: Sequence[Path] = ()
) -> None:
    """Check before writing that nothing would be overwritten.

    Args:
        copies: each image with the path of its copy.
        done: name of the operation, such as "undistort".
        force: whether existing files may be replaced.
        also: other files that will be written.

    Raises:
        InputError: an original image, another copy, or, without ``force``, an existing file would be
            overwritten.
    """
    inputs = {image.resolve() for image, _ in copies}
    outputs: dict[Path, Path] = {}
    for image, copy in copies:
        output = copy.resolve()
        if output in inputs:
            raise InputError(
                "it would overwrite an image it is made from; give another --out", source=str(copy)
            )
        other = outputs.setdefault(output, image)
        if other != image:
            raise InputError(
                f"both {other} and {image} would be written there; {done} them one by one", source=str(copy)
            )
    there = [] if force else [path for path in (*also, *(copy for _, copy in copies)) if path.exists()]
    if there:
        more = f" (and {len(there) - 1} more)" if len(there) > 1 else ""
        raise InputError(
            f"is there already{more}; --force replaces it, --out writes elsewhere", source=str(there[0])
        )
