"""The report of a build: its figures, the sections that explain them, and the pages that show these."""
