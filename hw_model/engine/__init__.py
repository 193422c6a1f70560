"""Two engines that run a phase of a program on recordings, with equal integers.

``reference`` is the plain one: numpy arrays, every compartment in every step. ``fast`` is compiled
by numba, leaves out what is at rest, and shares a batch between threads. Around it: ``lay_out``
arranges a phase for the loops, ``tiles``, ``delivery`` and ``chunks`` are the loops, and ``lanes``,
``packed`` and ``private_numba`` extend numba for them.
"""
