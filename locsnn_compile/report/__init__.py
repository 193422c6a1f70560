"""The report of a build: its figures, what is said of them, and the forms in which it is shown."""
