"""The registry's entries that a flight's images resolve to."""

from __future__ import annotations

from datetime import date
from pathlib import Path

from calibrary.catalogue import load_catalogue
from calibrary.errors import InputError
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.images.listing import Listing
from calibrary.jobs.images.reading import Question, here, read_images
from calibrary.registry.snapshot import Snapshot

__all__ = ["flight_entries"]


def flight_entries(
    snapshot: Snapshot, folder: Path, *, recursive: bool = False
) -> tuple[list[str], list[str]]:
    """Find the entries that extract would use for these images.

    Returns:
        Paths of the entries, and a sentence for each camera without one.

    Raises:
        InputError: the folder contains no images.
        RegistryError: the registry cannot be read.
    """
    images = Listing([folder], recursive=recursive)
    if images.known == 0:
        raise InputError("holds no images, and names no entry", source=str(folder))
    knowledge = Knowledge(catalogue=load_catalogue(), registry=snapshot.index(), on=date.today())
    paths: dict[str, None] = {}
    unanswered = []
    question = Question(days=True, list_all=images.known is not None)
    reading = read_images(images, question, engine=here(0, known=images.known))
    states = reading.images.settled().by_day
    dated = (
        (metadata, known)
        for metadata, days in states.items()
        for known, _ in knowledge.by_day(metadata, days)
    )
    for metadata, known in dated:
        if known.resolution is not None and known.resolution.revision is None:
            paths[known.resolution.path] = None
            continue
        if known.resolution is not None:
            unanswered.append(
                f"{known.resolution.path}: {known.resolution.why}; a lock pins one revision of an entry, that of now"
            )
            continue
        named = " ".join(text for text in (metadata.make, metadata.model) if text)
        near = f" ({known.near[0].path}: {known.near[0].reason})" if known.near else ""
        unanswered.append(f"no entry applies to {named or 'an image that names no camera'}{near}")
    return list(paths), unanswered
