"""Other trackers behind one signature, each with its honest best settings, to set torchsphere beside."""

from torchsphere.baselines.baseline import Baseline, Tracker
from torchsphere.baselines.ecc import ecc
from torchsphere.baselines.edge_fit import edge_fit
from torchsphere.baselines.hough import hough
from torchsphere.baselines.kornia_registrator import kornia_registrator
from torchsphere.baselines.lucas_kanade import lucas_kanade
from torchsphere.baselines.phase_correlation import phase_correlation
from torchsphere.baselines.published import published
from torchsphere.baselines.translation_only import translation_only

#: Every rival by its name, which the benchmark's command line resolves once.
TRACKERS: dict[str, Tracker] = {
    "translation_only": translation_only,
    "published": published,
    "ecc": ecc,
    "lucas_kanade": lucas_kanade,
    "phase_correlation": phase_correlation,
    "hough": hough,
    "edge_fit": edge_fit,
    "kornia_registrator": kornia_registrator,
}

__all__ = [
    "TRACKERS",
    "Baseline",
    "Tracker",
    "ecc",
    "edge_fit",
    "hough",
    "kornia_registrator",
    "lucas_kanade",
    "phase_correlation",
    "published",
    "translation_only",
]
