"""What a chip is loaded with: its type, its file, its checks, its text, and the builder."""
