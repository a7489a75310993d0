"""The files that a report links to."""

import dataclasses

from torchsphere.report import draw
from torchsphere.report.file_links import FIGURES, file_links
from torchsphere.results.reader import ResultFolder


def addresses(result: ResultFolder) -> list[str]:
    return [address for link in file_links(result) for _, address in link.files]


def test_every_link_leads_to_a_file_and_every_figure_has_a_link(result: ResultFolder) -> None:
    linked = addresses(result)
    assert all((result.path / address).is_file() for address in linked)
    figures = {path.name for path in (result.path / "figures").iterdir()} - {"thumbnail.webp"}
    assert {address.removeprefix("figures/") for address in linked if address.startswith("figures/")} == figures
    assert set(FIGURES) == set(draw.NUMBER_FIGURES) | set(draw.IMAGE_FIGURES)
    page = (result.path / "report.html").read_text()
    assert all(f'href="{address}"' in page for address in linked)


def test_an_overlay_that_is_made_after_the_report_is_linked_and_others_are_not(result: ResultFolder) -> None:
    assert "overlay.mp4" not in addresses(result)
    settings = result.summary["settings"] | {"overlay": True}
    asked = dataclasses.replace(result, summary=result.summary | {"settings": settings})
    assert "overlay.mp4" in addresses(asked)


def test_a_result_without_images_has_no_links_to_figures_of_images(result: ResultFolder) -> None:
    linked = addresses(dataclasses.replace(result, sampled=None, force_path=None))
    assert not any(name in address for address in linked for name in ("figures/path", "residuals", "figures/force"))
