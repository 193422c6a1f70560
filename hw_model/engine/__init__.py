"""The chip's step twice: the plain engine, and the compiled one that gives the same integers."""
