"""Where the parts of a job are done: here, by processes of this machine, or by the workers of a Dask cluster."""
