"""viewer.html: some recordings step by step, on both sides, to look into; a page with a script, unlike the report."""
