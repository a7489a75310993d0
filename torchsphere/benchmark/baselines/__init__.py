"""Other ball trackers behind one signature, each with the best settings found, to compare torchsphere with."""

from torchsphere.benchmark.baselines.baseline import Baseline, Tracker
from torchsphere.benchmark.baselines.ecc import ecc
from torchsphere.benchmark.baselines.edge_fit import edge_fit
from torchsphere.benchmark.baselines.hough import hough
from torchsphere.benchmark.baselines.kornia_registrator import kornia_registrator
from torchsphere.benchmark.baselines.lucas_kanade import lucas_kanade
from torchsphere.benchmark.baselines.phase_correlation import phase_correlation
from torchsphere.benchmark.baselines.reduced_models import published, translation_only

__all__ = ["TRACKERS", "Baseline", "hough"]

#: Every baseline by the name that the command line takes.
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
