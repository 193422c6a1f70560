"""Give a report its form: an HTML page, Markdown, text on the terminal, or CSV tables."""
