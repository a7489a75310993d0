"""The files of a result folder that its report links to."""

from __future__ import annotations

from dataclasses import dataclass

from torchsphere.results.reader import ResultFolder

#: Tables and other files: name and content, in the order of the report.
FILES = {
    "track.csv": "every frame, px and rad",
    "kinematics.csv": "every frame, SI units",
    "kinematics_cfc.csv": "acceleration and force by a channel frequency class",
    "force_path.csv": "force against penetration",
    "track.parquet": "track.csv with all covariances",
    "summary.json": "all numbers of this page, every setting, warnings",
}

#: Figures by their names; "path" and "residuals" are drawn of results that keep images.
FIGURES = {
    "motion": "position, velocity, force, spin",
    "rotation": "turned angles and spin",
    "force_path": "force against penetration",
    "path": "path over a frame",
    "residuals": "residual images",
    "quality": "correlation and status",
}

#: Files that an option makes: name, option in the settings, and content.
MADE_BY = (
    ("overlay.mp4", "overlay", "the video with circle, axes and path"),
    ("paraview/ball.pvd", "paraview", "a series for ParaView"),
)


@dataclass(frozen=True)
class Link:
    """A row of links to the files of one content: texts and addresses."""

    content: str
    files: tuple[tuple[str, str], ...]


def file_links(result: ResultFolder) -> list[Link]:
    """Links to all files of a result, those included that are drawn after the report."""
    found = [Link(about, ((name, name),)) for name, about in FILES.items() if (result.path / name).is_file()]
    for name, about in FIGURES.items():
        is_drawn = result.sampled is not None if name in ("path", "residuals") else True
        if is_drawn and (name != "force_path" or result.force_path is not None):
            forms = tuple((f"{name}.{kind}", f"figures/{name}.{kind}") for kind in ("png", "pdf"))
            found.append(Link(f"figure: {about}", forms))
    for name, option, about in MADE_BY:
        is_asked = bool(result.summary["settings"].get(option)) and result.known.any()
        if is_asked or (result.path / name).is_file():
            found.append(Link(about, ((name, name),)))
    return found
