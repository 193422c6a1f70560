"""Programs, which are what a chip is loaded with: their type, file, checks and text, and the builder."""
