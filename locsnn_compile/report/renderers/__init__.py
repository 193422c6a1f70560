"""The report as a page, Markdown, terminal text and tables."""
