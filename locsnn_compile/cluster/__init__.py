"""Where the parts of a job are done: in this process, or by the workers of a Dask cluster, which run the same code."""
