"""Archives: the recordings of a folder or a manifest, measured by several processes into a result folder each.

Start with `run`. It lists the recordings to measure (`manifest`, `key`, `records`), has an engine measure them
(`processes` or `dask_engine`, both through `work.run_job`), and writes the table of all recordings (`summary`).
"""
