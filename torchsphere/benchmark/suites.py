"""The suites of the benchmark: small TOML files that say what is rendered, and what is hard about it.

A file has ``title``, ``seed``, ``frames`` (a number for each of ``smoke`` and ``standard``) and a table ``[shot]`` as a
preset of the renderer has it. ``like = "plain"`` takes everything else from another file, so that a suite says what
it changes. ``[smoke.shot]`` changes the shot at the size ``smoke``, where few frames have to show the same.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

#: Where the suites of the package are.
FOLDER = Path(__file__).parent / "suites"

#: Sizes, and how often each suite is rendered, each time with another seed. A repetition rather than more frames: the
#: ball crosses the image in a given number of frames, and a second pattern tells more than a second crossing.
SIZES = {"smoke": 1, "standard": 1, "full": 10}

#: From the seed of one repetition to that of the next, so that no two recordings share a seed.
NEXT_SEED = 1000

_KEYS = ("title", "like", "seed", "frames", "shot", "smoke")


@dataclass(frozen=True)
class Recipe:
    """One recording to be made.

    Attributes
    ----------
    name, kind, title, seed
        As in `torchsphere.benchmark.folder.Suite`.
    shot : dict
        What the renderer makes it from, as its presets have it; the number of frames included.
    """

    name: str
    kind: str
    title: str
    seed: int
    shot: dict[str, Any]

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.shot["frames"])


def names() -> list[str]:
    """Names of the suites that come with the package: the plain one first, the others by the alphabet."""
    return sorted((path.stem for path in FOLDER.glob("*.toml")), key=lambda name: (name != "plain", name))


def recipes(suites: Sequence[str] | None, size: str, seed: int | None = None) -> list[Recipe]:
    """What has to be made for a benchmark.

    Parameters
    ----------
    suites : sequence of str, optional
        Names of suites, or paths of ``.toml`` files of one's own; all that come with the package unless given.
    size : str
        One of `SIZES`.
    seed : int, optional
        Added to the seed of each suite, for patterns and noise that nobody has seen before.

    Returns
    -------
    list of Recipe

    Raises
    ------
    ValueError
        With one sentence, where a suite or the size is not known, or a file is no suite.
    """
    if size not in SIZES:
        raise ValueError(f"size {size!r} is not known: expected one of {', '.join(SIZES)}")
    if seed is not None and seed < 0:
        raise ValueError(f"seed = {seed}: expected a whole number of at least 0")
    chosen = names() if suites is None else list(suites)
    made = [recipe for name in chosen for recipe in _repeated(find(name), size, seed or 0)]
    twice = sorted({recipe.kind for recipe in made if [r.name for r in made].count(recipe.name) > 1})
    if twice or not made:
        what = f"{twice[0]!r} is asked for twice" if twice else "there is none to be made"
        raise ValueError(f"suites: {what}; expected names from {', '.join(names())}, each once")
    return made


def find(name: str) -> Path:
    """The file of a suite.

    Raises
    ------
    ValueError
        Where there is none.
    """
    path = Path(name)
    if path.suffix == ".toml":
        if not path.is_file():
            raise ValueError(f"suite {name!r}: there is no such file; give its path, or one of {', '.join(names())}")
        return path
    if name not in names():
        raise ValueError(f"suite {name!r} is not known: expected one of {', '.join(names())}, or a .toml file's path")
    return FOLDER / f"{name}.toml"


def _repeated(path: Path, size: str, seed: int) -> list[Recipe]:
    """A suite as often as the size wants it."""
    table = _whole(path)
    own = {"smoke": "smoke", "standard": "standard", "full": "standard"}[size]
    shot = table["shot"] | {"frames": table["frames"][own]}
    if own == "smoke":
        shot = merged(shot, table.get("smoke", {}).get("shot", {}))
    count, kind = SIZES[size], path.stem
    return [
        Recipe(
            name=kind if count == 1 else f"{kind}.{i + 1}",
            kind=kind,
            title=table["title"],
            seed=table["seed"] + seed + NEXT_SEED * i,
            shot=shot,
        )
        for i in range(count)
    ]


def _whole(path: Path) -> dict[str, Any]:
    """The table of a suite with what it takes from another, checked."""
    own = _read(path)
    table = own
    if "like" in own:
        if own["like"] not in names() or path == find(own["like"]):
            raise ValueError(f"{path}: like = {own['like']!r}: expected the name of another suite of the package")
        # The other's changes at the size smoke are not taken over: they are made for its motion.
        other = {key: value for key, value in _whole(find(own["like"])).items() if key in ("frames", "shot")}
        table = merged(other, own)
    _check(path, table)
    return table


def _read(path: Path) -> dict[str, Any]:
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is no TOML file: {error}") from error
    unknown = [key for key in table if key not in _KEYS]
    if unknown:
        raise ValueError(f"{path}: {unknown[0]} is not known: expected {', '.join(_KEYS)}")
    return table


def _check(path: Path, table: dict[str, Any]) -> None:
    """Refuse what is no suite; what is wrong with its shot, the renderer says."""
    wanted = {"title": (str, "a text"), "seed": (int, "a whole number"), "frames": (dict, "a table")}
    for key, (kind, word) in (wanted | {"shot": (dict, "a table")}).items():
        if not isinstance(table.get(key), kind):
            raise ValueError(f"{path}: {key} = {table.get(key)!r}: expected {word}")
    for size in ("smoke", "standard"):
        count = table["frames"].get(size)
        # Fewer frames than three have no two increments to compare.
        if not isinstance(count, int) or count < 3:
            raise ValueError(f"{path}: frames.{size} = {count!r}: expected a whole number of at least 3")


def merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """The table with changes put in: tables are merged, all else, lists too, is replaced."""
    both = dict(base)
    for key, value in changes.items():
        old = both.get(key)
        both[key] = merged(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return both
