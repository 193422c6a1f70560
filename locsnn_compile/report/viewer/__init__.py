"""viewer.html: some recordings step by step on both sides, in a page that has a script, unlike the report."""
