"""Other trackers behind one signature, each with its honest best settings, to set torchsphere beside."""

from torchsphere.benchmark.baselines.baseline import Baseline, Tracker
from torchsphere.benchmark.baselines.ecc import ecc
from torchsphere.benchmark.baselines.edge_fit import edge_fit
from torchsphere.benchmark.baselines.hough import hough
from torchsphere.benchmark.baselines.kornia_registrator import kornia_registrator
from torchsphere.benchmark.baselines.lucas_kanade import lucas_kanade
from torchsphere.benchmark.baselines.phase_correlation import phase_correlation
from torchsphere.benchmark.baselines.published import published
from torchsphere.benchmark.baselines.translation_only import translation_only

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
