"""``--emit sanafe``: a program as files that SANA-FE runs."""
