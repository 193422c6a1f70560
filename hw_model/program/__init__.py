"""A program is what a chip is loaded with. This folder has its type, files, checks and text, and a builder by hand."""
