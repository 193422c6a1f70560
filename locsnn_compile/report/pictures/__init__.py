"""Draw SVG: the pictures inside report.html, and charts in files of their own."""
