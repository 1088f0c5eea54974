"""Who does the tasks of a sweep, one file an engine: each yields, in any order, how many scenes a task was."""

ENGINES = ("threads", "dask", "opencl")
