"""The seeds of the sets that judge the program: apart from each other, and seen by no test and no constant."""

from __future__ import annotations

import re
from pathlib import Path

from experiments.validation import attack, continuity, flights, model_precision, seeds

REPOSITORY = Path(__file__).resolve().parents[2]
JUDGING = (*seeds.ATTACK, *seeds.FLIGHTS, *seeds.MODEL_PRECISION)


def test_the_sets_have_seeds_of_their_own_that_were_not_used_before() -> None:
    spent = {seed for known in seeds.SPENT.values() for seed in known}
    assert len(set(JUDGING)) == len(JUDGING)
    assert not spent & set(JUDGING)


def test_the_experiments_take_these_seeds() -> None:
    assert attack.SEEDS == seeds.ATTACK
    assert flights.SEEDS == seeds.FLIGHTS
    assert model_precision.PATTERNS == seeds.MODEL_PRECISION
    assert flights.SEEDS[0] % 4 == 0, "the remainder chooses the film: each fourth of the flights has its own"


def test_no_test_no_constant_and_no_other_experiment_names_one_of_these_seeds() -> None:
    texts = [path for folder in ("tests", "experiments", "torchsphere") for path in (REPOSITORY / folder).rglob("*.py")]
    texts += [REPOSITORY / "docs" / "constants.toml"]
    texts.remove(REPOSITORY / "experiments" / "validation" / "seeds.py")
    judging = {str(seed) for seed in JUDGING}
    numbers = {path: set(re.findall(r"(?<![\w.])\d+", path.read_text(encoding="utf-8"))) for path in texts}
    assert {path: judging & found for path, found in numbers.items() if judging & found} == {}


def test_the_recordings_of_continuity_are_none_of_the_attack() -> None:
    source = Path(continuity.__file__).read_text(encoding="utf-8")
    used = {int(seed) for seed in re.findall(r'attacked\("[^"]+", (\d+)\)', source)}
    assert len(used) >= 10
    assert not used & {*seeds.ATTACK, *seeds.SPENT["attack"]}
