"""Names that the command line offers and reads, and its defaults, without the modules that use them.

``--help`` and a refused option need no torch. tests/settings/test_choices.py compares the names with those modules.
"""

#: Keys of `motion_models.MODELS`.
MODELS = ("translation", "published", "rigid", "finite", "pinhole", "pinhole6")

#: Methods of differentiation; the paper's figures are central differences.
METHODS = ("smoother", "savitzky-golay", "differences")

#: Default window (frames) and order of the local polynomials (docs/constants.toml).
WINDOW, ORDER = 7, 3

#: Channel frequency classes of ISO 6487 and SAE J211, for `channel_filter`.
CHANNEL_CLASSES = (60, 180, 600, 1000)

#: Choices for the map, and the argument of `torchsphere.track`.
MAPS: dict[str, bool | None] = {"auto": None, "on": True, "off": False}

#: Orders of the axes of an array of images: number (n), height (h) and width (w).
AXES = ("nhw", "hwn", "nwh", "whn", "hnw", "wnh")

#: Kinds of files in which all tables of a result are written together, and how their names end.
EXPORTS = {"hdf5": ".h5", "mat": ".mat"}

#: Colours of the 2 x 2 pixels of a colour mosaic, row by row.
BAYER = ("RGGB", "BGGR", "GRBG", "GBRG")

#: Supported devices.
DEVICES = ("cpu", "cuda")

#: Keys of `benchmark.suites.SIZES`.
SIZES = ("smoke", "standard", "full")

#: `benchmark.trackers.names`: variants of torchsphere, and other trackers.
TRACKERS = (
    *("torchsphere", "torchsphere-pairs", "torchsphere-map", "torchsphere-no-camera"),
    *("translation_only", "published", "ecc", "lucas_kanade"),
    *("phase_correlation", "hough", "edge_fit", "kornia_registrator"),
)
