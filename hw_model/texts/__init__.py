"""Fill text files that lie next to the code: templates of reports, help pages and generated sources."""
