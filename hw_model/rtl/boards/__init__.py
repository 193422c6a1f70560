"""Makefiles, pins and tops of the boards: what else is here goes into ``rtl/`` of ``--emit rtl`` as it is."""
