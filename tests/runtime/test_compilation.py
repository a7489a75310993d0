"""The word that loops are being compiled."""

import numba

from torchsphere.runtime.compilation import on_compilation


def test_the_first_compilation_is_told_once_and_a_compiled_loop_is_silent() -> None:
    first, second = numba.njit(lambda x: x + 1), numba.njit(lambda x: x + 2)
    told = []
    with on_compilation(lambda: told.append(1)):
        assert first(1) == 2
        assert second(1) == 3
    assert told == [1]
    with on_compilation(lambda: told.append(2)):
        assert first(1) == 2
    assert told == [1]
