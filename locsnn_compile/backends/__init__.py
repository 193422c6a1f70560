"""Emitters: they write a program as files for other tools, such as waveform viewers, graph tools and simulators.

Each kind of file has a module or a folder here; :mod:`locsnn_compile.emitters` lists them for ``--emit``.
"""
