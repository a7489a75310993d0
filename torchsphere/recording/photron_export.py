"""Images that Photron's software exported (TIFF, PNG), with the header that it wrote beside them.

The images carry no frame rate; the header has it, with exposure and trigger.
"""

from __future__ import annotations

from pathlib import Path

from torchsphere.recording.photron_header import HEADER_SUFFIXES, Header, facts_of, read_header
from torchsphere.recording.recording import Recording

#: What readers note where no frame rate is stated.
NO_RATE = "no frame rate"


def with_header_beside(recording: Recording) -> Recording:
    """The recording with the facts of the header of its export; unchanged without one."""
    path = _header_of(recording.path)
    if recording.frame_rate is not None or path is None:
        return recording
    try:
        header = read_header(path)
    except (ValueError, OSError) as error:
        return recording.changed(
            notes=(*recording.notes, f"The Photron header beside the images was not used: {error}.")
        )
    reason = _misfit(header, recording)
    if reason:
        note = f"The Photron header {path.name} beside the images was not used, as {reason}."
        return recording.changed(notes=(*recording.notes, note))
    return _with_facts(recording, header)


def _header_of(place: Path) -> Path | None:
    """The one header in a folder of images, or that with the name of the folder or the file beside it."""
    inside = [file for file in place.iterdir() if file.suffix.lower() in HEADER_SUFFIXES] if place.is_dir() else []
    endings = [end for suffix in HEADER_SUFFIXES for end in (suffix, suffix.upper())]
    beside = [place.parent / f"{name}{end}" for name in (place.name, place.stem) for end in endings]
    for candidates in (inside, beside):
        # A header with raw images of its own name belongs to these.
        found = [file for file in candidates if file.is_file() and not _has_raw_images(file)]
        if len({file.stem for file in found}) == 1:
            return min(found, key=lambda file: HEADER_SUFFIXES.index(file.suffix.lower()))
    return None


def _has_raw_images(header: Path) -> bool:
    return any(header.with_suffix(suffix).is_file() for suffix in (".mraw", ".MRAW"))


def _misfit(header: Header, recording: Recording) -> str:
    """Why a header is not that of the images; empty where it is."""
    for key, number, name in (("width", 2, "wide"), ("height", 1, "high")):
        stated = header.number(key)
        if stated is not None and stated != recording.shape[number]:
            return f"it states images {stated:g} px {name}, and these have {recording.shape[number]}"
    return "" if header.number("rate") else "it states no frame rate"


def _with_facts(recording: Recording, header: Header) -> Recording:
    count, notes = header.number("frames"), [note for note in recording.notes if NO_RATE not in note]
    if count is not None and count != len(recording):
        notes.append(
            f"The Photron header {header.path.name} states {count:g} images, and {len(recording)} are here: if single "
            "images are missing, motion across a gap comes out too fast."
        )
    facts, origins, header_notes = facts_of(header)
    return recording.changed(
        **facts,
        origins=dict(recording.origins) | {name: f"{field}, {header.path.name}" for name, field in origins.items()},
        notes=(*notes, *header_notes),
        files=(*recording.files, header.path),
    )
