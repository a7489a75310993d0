"""The cache of compiled loops."""

from torchsphere.kernels import forward_model, jit, registration


def test_a_loop_in_the_cache_belongs_to_the_files_of_all_loops() -> None:
    """A loop that calls a function of another file is compiled anew when that file changes."""
    names = [name for name, _, _ in jit.sources_stamp()]
    assert {"forward_model.py", "registration.py", "cube_map.py"} <= set(names)
    for loop in (registration._equations, forward_model._linearise):
        assert loop._cache._cache_file._source_stamp == jit.sources_stamp()
