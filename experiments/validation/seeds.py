"""Seeds of the recordings that judge the program: the attack, the flights and the forward model on fresh patterns.

No constant is chosen with a look at these recordings, for a set cannot judge what was chosen on it. A constant that was
all the same has ``judged_by`` in ``docs/constants.toml``. The seeds of the set are then spent, and new ones come here.

The leaderboard keeps its seeds: they belong to published suites, which users make by name and whose checksum
LEADERBOARD.md states. ``torchsphere benchmark make --seed N`` makes the same suites with patterns that no constant has
seen.
"""

from __future__ import annotations

#: Seeds of each case of `experiments.validation.attack`, in use since 2026-11-27.
ATTACK = tuple(range(71300, 71307))

#: Seeds of the flights of `experiments.validation.flights`, in use since 2026-11-27. The remainder by four chooses the
#: film, so that the first is a multiple of four.
FLIGHTS = tuple(range(71500, 71600))

#: Patterns of `experiments.validation.model_precision`, in use since 2026-11-27.
MODEL_PRECISION = (71701, 71702, 71703)

#: What judged before. Constants are measured on these (``--spent``), which judge no more.
SPENT = {
    "attack": tuple(range(300, 307)),
    "flights": tuple(range(500, 600)),
    "model_precision": (101, 102, 103),
}
