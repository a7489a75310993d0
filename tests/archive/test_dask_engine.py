"""The same archive through a Dask cluster."""

import functools
import logging
from collections.abc import Iterator
from pathlib import Path

import pytest
from archive_shots import COMMON, NAMES, PATIENCE_S, check_the_whole, kill_holder, measured, write_archive

from torchsphere.archive import dask_engine, manifest
from torchsphere.archive.run import Counts, run

distributed = pytest.importorskip("distributed", reason="the extra 'dask' is not installed")


@pytest.fixture(autouse=True)
def patience() -> Iterator[None]:
    """Dask gives a killed worker 15 s to start again; under heavy load, the imports alone may take longer."""
    import dask

    names = ("deploy.lost-worker-timeout", "scheduler.worker-ttl", "comm.timeouts.connect", "comm.timeouts.tcp")
    with dask.config.set({f"distributed.{name}": f"{PATIENCE_S:g}s" for name in names}):
        yield


def test_a_cluster_loses_only_the_recordings_that_kill_its_workers(tmp_path: Path) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    write_archive(source, NAMES)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=logging.CRITICAL
    ) as cluster:
        killer = kill_holder(source / "a" / "held2.pid")
        engine = functools.partial(dask_engine.run, address=cluster.scheduler_address, measure=measured)
        archive = manifest.read(source, COMMON, out)
        assert run(archive, out, engine).done == 9
        killer.join()
        check_the_whole(out, source)
        assert run(archive, out, engine) == Counts(done=9, failed=3, pending=0, measured=0)
        check_the_whole(out, source)


def test_a_cluster_of_workers_with_several_threads_is_refused(tmp_path: Path) -> None:
    with distributed.LocalCluster(
        n_workers=1,
        threads_per_worker=2,
        processes=False,
        dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    ) as cluster:
        engine = dask_engine.run(iter(()), cluster.scheduler_address, measured)
        with pytest.raises(ValueError, match="start them with --nthreads 1"):
            list(engine)


def test_an_address_without_a_scheduler_is_refused(tmp_path: Path) -> None:
    import dask

    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        pytest.raises(OSError, match="no Dask scheduler answers there"),
    ):
        list(dask_engine.run(iter(()), "tcp://127.0.0.1:9", measured))
