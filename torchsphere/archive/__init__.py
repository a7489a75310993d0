"""Many recordings: a folder or a manifest, measured by several processes, to one result folder each.

Read `run` first: what is to do (`manifest`, `key`, `records`), an engine that has it done (`processes` or
`dask_engine`, both through `work.settle`), and the table of it all (`summary`).
"""
