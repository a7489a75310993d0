"""Names that the command line offers, reads, and takes where nothing is said, without the libraries they stand for.

``--help`` and a wrong option wait for no torch. Each belongs to what it is the name of, in the module that is given
with it; tests/test_choices.py holds both together.
"""

#: Keys of `motion_models.MODELS`.
MODELS = ("translation", "published", "rigid", "finite", "pinhole", "pinhole6")

#: Ways to differentiate, and frames and order of the local polynomials where they are not given: the paper's figures
#: are central differences; 7 points of a cubic took 1.4 kN from a pulse of 29 kN and 14 frames.
METHODS = ("smoother", "savitzky-golay", "differences")
WINDOW, ORDER = 7, 3

#: What may be said of the map, and what it means to `torchsphere.track`.
MAPS: dict[str, bool | None] = {"auto": None, "on": True, "off": False}

#: Where to compute.
DEVICES = ("cpu", "cuda")

#: `result.STATUSES`: the words that a frame may have in `track.csv`.
STATUSES = ("ok", "weak_texture", "low_correlation", "not_converged", "out_of_frame", "lost")

#: Keys of `benchmark.suites.SIZES`.
SIZES = ("smoke", "standard", "full")

#: `benchmark.trackers.names`: torchsphere's own settings, and the rivals.
TRACKERS = (
    *("torchsphere", "torchsphere-pairs", "torchsphere-map", "torchsphere-no-camera"),
    *("translation_only", "published", "ecc", "lucas_kanade"),
    *("phase_correlation", "hough", "edge_fit", "kornia_registrator"),
)
