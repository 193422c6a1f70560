"""How the networks of :mod:`locsnn_compile.models` learn: the options of a run, its losses and its loop."""
